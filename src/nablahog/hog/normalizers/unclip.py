"""The shares and levels of cells that four blocks have normalised and clipped: sums over both are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

NEWTON_STEPS = 5  # of Newton's method
TINY_RATIO = 1e-6


def unclip(summed: Tensor, totals: Tensor, clip: float, rounds: int) -> tuple[Tensor, Tensor, Tensor]:
    """Histograms h of cells in blocks of energy N², with ½ Σ over blocks and Σ over bins of min(h / N, clip) known.

    Args:
        summed: (B, n, rows, cols), ½ Σ over the four blocks of a cell.
        totals: (B, 4, rows, cols), Σ over bins.
        clip: of h / N.
        rounds: in each, ratios are found for fixed shares, then shares for fixed ratios.

    Returns:
        Shares h / Σh (B, 1, n, rows, cols); ratios Σh / N (B, 4, 1, rows, cols); and which ratios are determined.
    """
    totals, shares = totals.unsqueeze(2), summed.unsqueeze(1)
    for _ in range(rounds):
        shares = shares / shares.sum(dim=2, keepdim=True).clamp(min=TINY_RATIO)
        ratios, known = solve_clipped(shares, totals, clip, dim=2)
        shares, _ = solve_clipped(ratios, 2 * summed.unsqueeze(1), clip, dim=1)
    return shares, ratios, known


def solve_clipped(weights: Tensor, totals: Tensor, clip: float, dim: int) -> tuple[Tensor, Tensor]:
    """x with Σ min(weights · x, clip) = totals over a dimension, and where it is determined.

    The sum is concave and piecewise linear in x, so Newton's method reaches x from below, from 0.
    """
    import torch

    x = torch.zeros_like(totals)
    slopes = weights.sum(dim, keepdim=True).expand_as(x)
    for _ in range(NEWTON_STEPS):
        remainder = totals - (weights * x).clamp(max=clip).sum(dim, keepdim=True)
        x = torch.where(slopes > TINY_RATIO, x + remainder / slopes.clamp(min=TINY_RATIO), x)
        slopes = torch.where(weights * x < clip, weights, 0).sum(dim, keepdim=True)
    return x, slopes > TINY_RATIO


def sum_over_blocks(cell_ratios: Tensor) -> Tensor:
    """Sums over the cells of each block: (B, 4, rows, cols), by up-left … down-right, to (B, 1, rows + 1, cols + 1)."""
    batch, _, rows, cols = cell_ratios.shape
    blocks = cell_ratios.new_zeros(batch, rows + 1, cols + 1)
    for k, (down, right) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        blocks[:, down : down + rows, right : right + cols] += cell_ratios[:, k]
    return blocks.unsqueeze(1)
