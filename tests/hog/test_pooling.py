"""The matrices of Eq. 5-6 in large images: what they are in small ones, every entry, is in test_reference.py."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from nablahog.hog import presets
from nablahog.hog.steps import pooling_matrices

SINGLE, DOUBLE = torch.empty(0), torch.empty(0, dtype=torch.float64)


def by_row(cell: int, cells: int, like: Tensor) -> Tensor:
    return pooling_matrices(presets.paper((cell, 8)), cell * cells, 8, like)[0]


@pytest.mark.parametrize("like", [SINGLE, DOUBLE])
@pytest.mark.parametrize("cell", [1, 2, 3, 5, 6, 7, 8, 11])
def test_weights_are_alike_wherever_the_cell_is(cell: int, like: Tensor) -> None:
    matrix = by_row(cell, 2000, like)
    near, far = (matrix[k, (k - 1) * cell : (k + 2) * cell] for k in (1, 1998))
    assert torch.equal(near, far)
    assert (matrix.sum(dim=1)[1:-1] - cell).abs().max() < 1e-5 * cell


@pytest.mark.parametrize("cell", [3, 5, 7])
def test_far_from_the_origin_no_digit_is_lost(cell: int) -> None:
    assert torch.equal(by_row(cell, 2000, SINGLE), by_row(cell, 2000, DOUBLE).float())


@pytest.mark.parametrize("cell", [3, 5, 7, 11])
def test_a_pixel_at_a_centre_votes_into_its_cell_alone(cell: int) -> None:
    assert torch.equal(by_row(cell, 2000, SINGLE)[:, cell // 2 :: cell], torch.eye(2000))
