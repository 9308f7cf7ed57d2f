"""The shares and levels of cells that four blocks have normalised and clipped: sums over both are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

NEWTON_STEPS = 5  # of Newton's method
TINY_RATIO = 1e-6
SETTLED = 1e-13  # most change of a share of float64 in a round after which it changes no more
NUMBERS_AT_ONCE = 2**15  # fewer than PyTorch would share among threads, which wait for each other in short loops


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
    summed, totals = summed.unsqueeze(1), totals.unsqueeze(2)
    shares = summed
    for _ in range(rounds):
        shares, ratios, known = _improve(shares, summed, totals, clip)
    return shares, ratios, known


def unclip_exactly(summed: Tensor, totals: Tensor, clip: float, rounds: int) -> tuple[Tensor, Tensor, Tensor]:
    """The same of float64 for many rounds, from which cells are left out once they have settled."""
    import torch

    batch, bins, *grid = summed.shape
    columns = [values.movedim(1, 0).flatten(1) for values in (summed, totals)]  # of cells
    parts = zip(*(torch.split(values, max(1, NUMBERS_AT_ONCE // (4 * bins)), dim=1) for values in columns), strict=True)
    results = zip(
        *(_settle(part[None, None], total[None, :, None], clip, rounds) for part, total in parts), strict=True
    )
    shares, ratios, known = (torch.unflatten(torch.cat(part, dim=-1)[0], -1, (batch, *grid)) for part in results)
    return shares.movedim(2, 0), ratios.movedim(2, 0), known.movedim(2, 0)


def _settle(summed: Tensor, totals: Tensor, clip: float, rounds: int) -> tuple[Tensor, Tensor, Tensor]:
    """The same of cells (1, 1, n, cells) and (1, 4, 1, cells)."""
    import torch

    shares, ratios, known = _improve(summed, summed, totals, clip)
    moving = torch.arange(summed.shape[-1])
    for _ in range(rounds - 1):
        before = shares[..., moving]
        now, new_ratios, new_known = _improve(before, summed[..., moving], totals[..., moving], clip)
        shares[..., moving], ratios[..., moving], known[..., moving] = now, new_ratios, new_known
        moving = moving[((now - before).abs() > SETTLED).flatten(0, -2).any(0)]
        if not len(moving):
            break
    return shares, ratios, known


def _improve(shares: Tensor, summed: Tensor, totals: Tensor, clip: float) -> tuple[Tensor, Tensor, Tensor]:
    """One round: shares, ratios, and which ratios are determined."""
    shares = shares / shares.sum(dim=2, keepdim=True).clamp(min=TINY_RATIO)
    ratios, known = solve_clipped(shares, totals, clip, dim=2)
    return solve_clipped(ratios, 2 * summed, clip, dim=1)[0], ratios, known


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
