"""The four-block normaliser in one pass over the cells, and its adjoint in another."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ...compile import compiled
from ..normalize import TEXTURE_SCALE, global_norm
from ..spec import FourBlockNorm, GlobalNorm, HOGSpec


@compiled
def _factors(histograms: Any, epsilon: Any) -> Any:
    """1 / √(energy + ε) of the blocks around cell corners, (rows + 1, cols + 1); beyond the grid the edge repeats."""
    bins, rows, cols = histograms.shape
    n = bins // 2
    energy = np.zeros((rows, cols), histograms.dtype)
    for o in range(n):
        for y in range(rows):
            for x in range(cols):
                undirected = histograms[o, y, x] + histograms[o + n, y, x]
                energy[y, x] += undirected * undirected
    factors = np.empty((rows + 1, cols + 1), histograms.dtype)
    for y in range(rows + 1):
        up, down = max(y - 1, 0), min(y, rows - 1)
        for x in range(cols + 1):
            left, right = max(x - 1, 0), min(x, cols - 1)
            block = (energy[up, left] + energy[up, right]) + (energy[down, left] + energy[down, right])
            factors[y, x] = 1 / math.sqrt(block + epsilon)
    return factors


@compiled
def _normalize(histograms: Any, clip: Any, texture_scale: Any, half: Any, factors: Any, found: Any) -> None:
    """Histograms (2n, rows, cols) to ``found`` (3n + 4, rows, cols), which is 0 before."""
    bins, rows, cols = histograms.shape
    n = bins // 2
    for block in range(4):
        dy, dx = block // 2, block % 2
        for o in range(bins + n):
            for y in range(rows):
                for x in range(cols):
                    entry = histograms[o, y, x] if o < bins else histograms[o - bins, y, x] + histograms[o - n, y, x]
                    entry *= factors[y + dy, x + dx]
                    entry = clip if entry > clip else entry
                    found[o, y, x] += half * entry
                    if o >= bins:
                        found[bins + n + block, y, x] += texture_scale * entry


@compiled
def _normalize_adjoint(
    histograms: Any, clip: Any, texture_scale: Any, half: Any, factors: Any, given: Any, found: Any
) -> None:
    """Adds to ``found`` (2n, rows, cols) what reaches the histograms from ``given`` (3n + 4, rows, cols)."""
    bins, rows, cols = histograms.shape
    n = bins // 2
    to_factors = np.zeros_like(factors)
    for block in range(4):
        dy, dx = block // 2, block % 2
        for o in range(bins + n):
            for y in range(rows):
                for x in range(cols):
                    factor = factors[y + dy, x + dx]
                    to_entry = half * given[o, y, x]
                    if o < bins:
                        entry = histograms[o, y, x]
                    else:
                        entry = histograms[o - bins, y, x] + histograms[o - n, y, x]
                        to_entry += texture_scale * given[bins + n + block, y, x]
                    product = entry * factor
                    if product > clip:
                        to_entry = half - half
                    elif product == clip:  # the mean of both sides
                        to_entry *= half
                    to_factors[y + dy, x + dx] += to_entry * entry
                    if o < bins:
                        found[o, y, x] += to_entry * factor
                    else:
                        found[o - bins, y, x] += to_entry * factor
                        found[o - n, y, x] += to_entry * factor
    to_energy = np.zeros((rows, cols), histograms.dtype)
    for y in range(rows + 1):
        up, down = max(y - 1, 0), min(y, rows - 1)
        for x in range(cols + 1):
            left, right = max(x - 1, 0), min(x, cols - 1)
            to_block = -half * to_factors[y, x] * factors[y, x] * factors[y, x] * factors[y, x]
            to_energy[up, left] += to_block
            to_energy[up, right] += to_block
            to_energy[down, left] += to_block
            to_energy[down, right] += to_block
    for o in range(n):
        for y in range(rows):
            for x in range(cols):
                to_undirected = 2 * (histograms[o, y, x] + histograms[o + n, y, x]) * to_energy[y, x]
                found[o, y, x] += to_undirected
                found[o + n, y, x] += to_undirected


class _FourBlocks(torch.autograd.Function):
    """Histograms (B, 2n, rows, cols) to (B, 3n + 4, rows, cols)."""

    @staticmethod
    def forward(ctx: Any, histograms: Tensor, scheme: FourBlockNorm) -> Tensor:
        entries = histograms.detach().contiguous().numpy()
        dtype = entries.dtype.type
        batch, bins, rows, cols = entries.shape
        ctx.constants = dtype(scheme.clip), dtype(TEXTURE_SCALE), dtype(0.5)
        ctx.entries, ctx.factors = entries, [_factors(one, dtype(scheme.epsilon)) for one in entries]
        found = np.zeros((batch, scheme.channels(bins), rows, cols), dtype)
        for one, factors, to in zip(entries, ctx.factors, found, strict=True):
            _normalize(one, *ctx.constants, factors, to)
        return torch.from_numpy(found)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
        found = np.zeros_like(ctx.entries)
        for one, factors, of, to in zip(ctx.entries, ctx.factors, given.contiguous().numpy(), found, strict=True):
            _normalize_adjoint(one, *ctx.constants, factors, of, to)
        return torch.from_numpy(found), None


def four_block_norm(histograms: Tensor, scheme: FourBlockNorm) -> Tensor:
    """:func:`nablahog.hog.normalize.four_block_norm` on a CPU, differentiable once, in reverse mode."""
    found: Tensor = _FourBlocks.apply(histograms, scheme)  # type: ignore[no-untyped-call]
    return found


def normalize(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """:func:`nablahog.hog.normalize.normalize` on a CPU, differentiable once, in reverse mode."""
    if isinstance(spec.normalizer, GlobalNorm):
        return global_norm(histograms, spec.normalizer)  # a few passes over cells, no loop of its own would be faster
    return four_block_norm(histograms, spec.normalizer)
