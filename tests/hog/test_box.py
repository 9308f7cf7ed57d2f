"""One order of coordinates: x before y, ends excluded."""

from __future__ import annotations

import numpy as np
import pytest

from nablahog.hog.box import Box

BOX = Box(1, 2, 5, 9)


def test_x_is_the_column() -> None:
    assert (BOX.width, BOX.height) == (4, 7)
    image = np.arange(200).reshape(10, 20)
    part = image[BOX.rows, BOX.cols]
    assert part.shape == (7, 4)
    assert part[0, 0] == image[2, 1]


@pytest.mark.parametrize("sides", [(1, 2, 5, 9), [1, 2, 5, 9], np.array([1, 2, 5, 9])])
def test_lists_and_arrays_are_accepted(sides: list[float]) -> None:
    assert Box.of(sides) == BOX


def test_four_numbers() -> None:
    with pytest.raises(ValueError, match="a box must be x0, y0, x1, y1"):
        Box.of([1, 2, 3])


def test_intersection() -> None:
    assert BOX.intersect(Box(0, 5, 3, 20)) == (1, 5, 3, 9)
    assert BOX.iou(Box(0, 5, 3, 20)) == 8 / (28 + 45 - 8)
    assert BOX.iou(BOX) == 1
    assert BOX.intersect(Box(5, 2, 6, 9)).width == 0
    assert BOX.iou(Box(6, 10, 8, 12)) == 0  # apart in both directions
    assert BOX.iou(Box(5, 0, 9, 9)) == 0
    assert Box(0, 0, 0, 0).iou(Box(0, 0, 0, 0)) == 0
