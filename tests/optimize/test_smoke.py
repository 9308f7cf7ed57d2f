"""A valley and its lowest point."""

from __future__ import annotations

import pytest
import torch

from nablahog.optimize import MINIMISERS

from .problems import SumOfSquares


@pytest.mark.parametrize("name", MINIMISERS)
def test_a_valley(name: str) -> None:
    """(x - 3)² + 4 (y + 1)², from (0, 0) and from (9, 9)."""
    problem = SumOfSquares(lambda points, index: torch.stack([points[:, 0] - 3, 2 * (points[:, 1] + 1)], dim=1))
    start = torch.tensor([[0.0, 0.0], [9.0, 9.0]], dtype=torch.float64)
    minimum = MINIMISERS[name](problem, start, max_evaluations=200)
    torch.testing.assert_close(minimum.x, torch.tensor([[3.0, -1.0], [3.0, -1.0]]).double(), rtol=0, atol=1e-3)
    assert (minimum.evaluations <= 200).all()
