"""Histograms of four-block descriptors, in closed form but for the clip: the start of a search for them.

A texture channel is t = c · Σ_o min(h_o / N, clip), of a cell h and one of its four blocks, with energy N².  Without
the clip it is the ratio of the cell's level Σ_o h_o to N, so the levels of the cells of one block are known relative to
each other.  Over all blocks, their logarithms solve Poisson's equation.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..hog.normalizers.four_block import DPM_TEXTURE, VLFEAT_TEXTURE, FourBlockNorm, in_dpm_order
from ..hog.spec import HOGSpec
from .unknowns import from_cosines, to_cosines

BLOCK_ROUNDS = 4  # in each, ratios are found for fixed shares, then shares for fixed ratios
NEWTON_STEPS = 5  # of Newton's method
LEVEL_ITERATIONS, LEVEL_ACCURACY = 12, 1e-8  # of conjugate gradients; more iterations make no difference
LEAST_ENTRY = 1e-3  # lower limit of entries, relative to the largest of their cell, so that logarithms are finite
TINY_RATIO = 1e-6


def histograms_without_clip(descriptor: Tensor, spec: HOGSpec) -> Tensor | None:
    """Histograms (B, bins, rows, cols) of descriptors (B, rows, cols, channels), of mean level 1.

    None for a descriptor that does not tell blocks apart: one without texture, or without the histograms that it sums.
    """
    normalizer = spec.normalizer
    if not isinstance(normalizer, FourBlockNorm):
        return None
    parts = normalizer.split(descriptor.permute(0, 3, 1, 2), spec.bins, spec.signed)
    vlfeat = normalizer.texture == "vlfeat"
    summed = parts.get("undirected" if vlfeat else "directed")
    if summed is None or "texture" not in parts:
        return None
    texture = parts["texture"] if vlfeat else torch.stack(in_dpm_order(parts["texture"].unbind(1)), dim=1)
    totals = (texture / (VLFEAT_TEXTURE if vlfeat else DPM_TEXTURE)).unsqueeze(2)  # (B, 4, 1, rows, cols)
    shares = summed.unsqueeze(1)  # (B, 1, n, rows, cols), of the cell's level
    for _ in range(BLOCK_ROUNDS):
        shares = shares / shares.sum(dim=2, keepdim=True).clamp(min=TINY_RATIO)
        ratios, known = _solve_clipped(shares, totals, normalizer.clip, dim=2)  # h / N by block: (B, 4, 1, rows, cols)
        shares, _ = _solve_clipped(ratios, 2 * summed.unsqueeze(1), normalizer.clip, dim=1)
    if "directed" in parts and vlfeat:
        shares, _ = _solve_clipped(ratios, 2 * parts["directed"].unsqueeze(1), normalizer.clip, dim=1)
    known &= totals > TINY_RATIO
    levels = _solve_levels(ratios.double().clamp(min=TINY_RATIO).log().squeeze(2), known.squeeze(2).double())
    shares = shares.squeeze(1)
    floor = LEAST_ENTRY * shares.amax(dim=1, keepdim=True)
    return shares.clamp(min=floor) * torch.exp(levels).to(shares)


def _solve_clipped(weights: Tensor, totals: Tensor, clip: float, dim: int) -> tuple[Tensor, Tensor]:
    """x with Σ min(weights · x, clip) = totals over a dimension, and where it is determined.

    The sum is concave and piecewise linear in x, so Newton's method reaches x from below, from 0.
    """
    x = torch.zeros_like(totals)
    slopes = weights.sum(dim, keepdim=True).expand_as(x)
    for _ in range(NEWTON_STEPS):
        left = totals - (weights * x).clamp(max=clip).sum(dim, keepdim=True)
        x = torch.where(slopes > TINY_RATIO, x + left / slopes.clamp(min=TINY_RATIO), x)
        slopes = torch.where(weights * x < clip, weights, 0).sum(dim, keepdim=True)
    return x, slopes > TINY_RATIO


def _solve_levels(ratios: Tensor, known: Tensor) -> Tensor:
    """Logarithms of levels (B, 1, rows, cols), of mean 0, from those of ratios (B, 4, rows, cols) to blocks.

    Least squares, where ``known`` is 1, over the levels of cells and of blocks.  Those of blocks are means, which
    leaves equations for those of cells; if all ratios are known, the cosine basis solves them.
    """
    blocks = _to_blocks(known).clamp(min=TINY_RATIO)

    def apart(of_cells: Tensor) -> Tensor:
        """Σ over its blocks of a cell's difference from the mean of the block: (B, 4, rows, cols) to (B, 1, …)."""
        means = _from_blocks(_to_blocks(known * of_cells) / blocks)
        return (known * (of_cells - means)).sum(dim=1, keepdim=True)

    rows, cols = (torch.cos(math.pi * torch.arange(n, dtype=torch.float64) / (2 * n)) ** 2 for n in ratios.shape[2:])
    spectrum = 4 * (1 - torch.outer(rows, cols))
    spectrum[0, 0] = math.inf
    spectrum = spectrum.to(ratios)
    levels, residual = torch.zeros_like(ratios[:, :1]), apart(ratios)
    direction = solved = from_cosines(to_cosines(residual) / spectrum)
    first = error = (residual * solved).sum(dim=(1, 2, 3), keepdim=True)
    for _ in range(LEVEL_ITERATIONS):  # preconditioned conjugate gradients
        runs, image = error > LEVEL_ACCURACY * first, apart(direction.expand_as(ratios))
        curvature = (direction * image).sum(dim=(1, 2, 3), keepdim=True)
        step = torch.where(runs, error / curvature, 0)
        levels, residual = levels + step * direction, residual - step * image
        solved, before = from_cosines(to_cosines(residual) / spectrum), error
        error = (residual * solved).sum(dim=(1, 2, 3), keepdim=True)
        direction = solved + torch.where(runs, error / before, 0) * direction
    return levels - levels.mean(dim=(2, 3), keepdim=True)


def _to_blocks(of_cells: Tensor) -> Tensor:
    """Sums over the cells of each block: (B, 4, rows, cols), by up-left … down-right, to (B, 1, rows + 1, cols + 1)."""
    batch, _, rows, cols = of_cells.shape
    blocks = of_cells.new_zeros(batch, rows + 1, cols + 1)
    for k, (down, right) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        blocks[:, down : down + rows, right : right + cols] += of_cells[:, k]
    return blocks.unsqueeze(1)


def _from_blocks(blocks: Tensor) -> Tensor:
    """The four blocks of each cell: (B, 1, rows + 1, cols + 1) to (B, 4, rows, cols)."""
    top, bottom = blocks[:, :, :-1], blocks[:, :, 1:]
    return torch.cat([top[..., :-1], top[..., 1:], bottom[..., :-1], bottom[..., 1:]], dim=1)
