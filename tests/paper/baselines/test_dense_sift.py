"""Dense SIFT: descriptors of known windows, and what changes them."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import torch

from nablahog.paper.baselines.dense_sift import dense_sift, sift_grid

from ...invert.photographs import photograph


def _reference(image: np.ndarray[Any, Any], cell: int, top: int, left: int) -> np.ndarray[Any, Any]:
    """The votes of one window (4, 4, 8), weighed, pixel by pixel."""
    votes = np.zeros((4, 4, 8))
    height, width = image.shape
    for y, x in itertools.product(range(1, height - 1), range(1, width - 1)):
        gx, gy = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
        turn = math.atan2(gy, gx) / (2 * math.pi) * 8 % 8
        for i, j, k in itertools.product(range(4), range(4), range(8)):
            down = 1 - abs((y + 0.5 - top) / cell - (i + 0.5))
            across = 1 - abs((x + 0.5 - left) / cell - (j + 0.5))
            around = 1 - min(abs(turn - k), 8 - abs(turn - k))
            if min(down, across, around) > 0:
                votes[i, j, k] += math.hypot(gx, gy) * down * across * around
    for i, j in itertools.product(range(4), range(4)):
        votes[i, j] *= math.exp(-((i - 1.5) ** 2 + (j - 1.5) ** 2) / 8)
    return votes


def test_against_a_pixelwise_reference() -> None:
    image = photograph(24)
    result = dense_sift(image.double(), 5)
    assert result.shape == (1, 1, 1, 128)
    expected = _reference(image[0, 0].double().numpy(), 5, 0, 0).ravel()
    expected = np.minimum(expected / np.linalg.norm(expected), 0.2)
    np.testing.assert_allclose(result[0, 0, 0], expected / np.linalg.norm(expected), atol=1e-12)


@pytest.mark.parametrize("cell", [4, 8])
def test_the_least_edge_that_is_seen(cell: int) -> None:
    for levels, seen in ((1, False), (2, True)):
        edge = torch.full((1, 1, 4 * cell, 4 * cell), 0.5)
        edge[..., 2 * cell :] += levels / 255
        assert dense_sift(edge, cell).any() == seen


def test_one_window_at_each_cell() -> None:
    assert sift_grid(128, 128, 8) == (13, 13)
    assert sift_grid(31, 47, 8) == (0, 2)
    image = photograph(64)
    shifted = dense_sift(image[..., 8:, 4:], 4)
    torch.testing.assert_close(dense_sift(image, 4)[:, 4:-1, 3:-1], shifted[:, 2:-1, 2:-1], atol=1e-6, rtol=0)
