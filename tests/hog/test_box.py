"""Boxes: x before y, ends excluded; and where cells are, against where the operator finds a single bright pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from nablahog.hog import BlockCells, BlockNorm, HOGSpec, hog, presets
from nablahog.hog.box import cell_centres, pixel_box
from nablahog.inputs.boxes import Box

from .zoo import spec

BOX = Box(1, 2, 5, 9)


CELLS: dict[str, HOGSpec] = {
    "paper": presets.paper((4, 6)),
    "vlfeat": presets.vlfeat(cell_size=5),
    "dpm": presets.dpm(4),
    "dlib": presets.dlib(5),
    "piotr": presets.piotr(4),
    "ceil": spec(partial_cells="ceil", cell_size=(5, 3)),
}
BLOCKS: dict[str, HOGSpec] = {
    "skimage": presets.skimage(pixels_per_cell=(4, 5), cells_per_block=(3, 2)),
    "steps": replace(presets.skimage(pixels_per_cell=(2, 3)), normalizer=BlockNorm((2, 1), (3, 2))),
    "opencv": presets.opencv((40, 40), (16, 8), (6, 4), (8, 4)),
    "maskfeat": presets.maskfeat(6),
}
sizes = st.tuples(st.integers(16, 60), st.integers(16, 60))


def found_at(s: HOGSpec, size: tuple[int, int], row: int, col: int) -> np.ndarray:
    """Which rows and columns of the descriptor see one bright pixel; and the four that have a gradient."""
    image = torch.zeros(1, 1, *size, dtype=torch.float64)
    image[..., row, col] = 1
    result: np.ndarray = (hog(image, s)[0] != 0).any(dim=2).numpy()
    return result


def gradients(row: int, col: int) -> list[tuple[int, int]]:
    return [(row, col - 1), (row, col + 1), (row - 1, col), (row + 1, col)]


@given(name=st.sampled_from(sorted(CELLS)), size=sizes, data=st.data())
@settings(max_examples=40)
def test_cells_see_pixels_less_than_a_cell_from_their_centres(
    name: str, size: tuple[int, int], data: st.DataObject
) -> None:
    """Of whole cells, and not of what DPM counts again or others leave out behind the last one."""
    s = CELLS[name]
    size = (size[0] // s.cell_size[0] * s.cell_size[0], size[1] // s.cell_size[1] * s.cell_size[1])
    row, col = (data.draw(st.integers(2, n - 3)) for n in size)
    ys, xs = cell_centres(s, size)
    expected = np.zeros((len(ys), len(xs)), bool)
    for y, x in gradients(row, col):
        expected |= np.outer(np.abs(ys - y) < s.cell_size[0], np.abs(xs - x) < s.cell_size[1])
    assert np.array_equal(found_at(s, size, row, col), expected)


@given(name=st.sampled_from(sorted(BLOCKS)), size=sizes, data=st.data())
@settings(max_examples=40)
def test_blocks_and_boxes_see_their_own_pixels(name: str, size: tuple[int, int], data: st.DataObject) -> None:
    s = BLOCKS[name]
    row, col = (data.draw(st.integers(2, n - 3)) for n in size)
    rows, cols = s.grid(*size)
    seen = gradients(row, col)
    if name == "maskfeat":  # its mask is of three rows and columns
        seen += [(row + dy, col + dx) for dy in (-1, 1) for dx in (-1, 1)]
    expected = np.zeros((rows, cols), bool)
    for i, j in np.ndindex(rows, cols):
        box = pixel_box(s, size, Box(j, i, j + 1, i + 1))
        expected[i, j] = any(box.y0 <= y < box.y1 and box.x0 <= x < box.x1 for y, x in seen)
    assert np.array_equal(found_at(s, size, row, col), expected)


@pytest.mark.parametrize("name", CELLS | BLOCKS)
def test_centres_are_those_of_the_boxes(name: str) -> None:
    s, size = (CELLS | BLOCKS)[name], (60, 60)
    ys, xs = cell_centres(s, size)
    assert (len(ys), len(xs)) == s.grid(*size)
    for i, j in np.ndindex(len(ys), len(xs)):
        box = pixel_box(s, size, Box(j, i, j + 1, i + 1))
        assert ys[i] == (box.y0 + box.y1 - 1) / 2
        assert xs[j] == (box.x0 + box.x1 - 1) / 2


def test_in_numbers() -> None:
    ys, xs = cell_centres(presets.vlfeat(), (20, 32))
    assert ys.tolist() == [3.5, 11.5, 19.5]  # the last is half in the image
    assert xs.tolist() == [3.5, 11.5, 19.5, 27.5]
    assert cell_centres(presets.dpm(), (32, 40))[1].tolist() == [11.5, 19.5, 27.5]
    assert cell_centres(presets.opencv(), (128, 64))[1].tolist() == [7.5, 15.5, 23.5, 31.5, 39.5, 47.5, 55.5]
    assert pixel_box(presets.dpm(), (64, 96), Box(1, 0, 3, 2)) == (16, 8, 32, 24)
    assert pixel_box(presets.skimage(), (64, 64), Box(1, 0, 2, 2)) == (8, 0, 32, 32)
    assert pixel_box(presets.vlfeat(), (20, 32), [0, 2, 1, 3]) == (0, 16, 8, 20)
    assert isinstance(presets.opencv().pooling, BlockCells)
    assert pixel_box(presets.opencv(), (128, 64), Box(0, 0, 7, 15)) == (0, 0, 64, 128)


@pytest.mark.parametrize("cells", [Box(0, 0, 1, 0), Box(0, 0, 6, 1), Box(0, -1, 1, 1), Box(0, 3, 1, 2)])
def test_windows_are_within_the_descriptor(cells: Box) -> None:
    with pytest.raises(ValueError, match="some of the descriptor's 5 rows and 5 columns"):
        pixel_box(presets.vlfeat(), (40, 40), cells)


def test_x_is_the_column() -> None:
    assert (BOX.width, BOX.height) == (4, 7)
    image = np.arange(200).reshape(10, 20)
    part = image[BOX.rows, BOX.cols]
    assert part.shape == (7, 4)
    assert part[0, 0] == image[2, 1]


def test_intersection() -> None:
    assert BOX.intersect(Box(0, 5, 3, 20)) == (1, 5, 3, 9)
    assert BOX.iou(Box(0, 5, 3, 20)) == 8 / (28 + 45 - 8)
    assert BOX.iou(BOX) == 1
    assert BOX.intersect(Box(5, 2, 6, 9)).width == 0
    assert BOX.iou(Box(6, 10, 8, 12)) == 0  # apart in both directions
    assert BOX.iou(Box(5, 0, 9, 9)) == 0
    assert Box(0, 0, 0, 0).iou(Box(0, 0, 0, 0)) == 0
