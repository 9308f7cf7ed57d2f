"""The four-block normaliser in one pass over the cells, and its adjoint in another."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ...compile import compiled
from ..normalize import VLFEAT_TEXTURE, global_norm
from ..normalizers import FourBlockNorm, GlobalNorm, Part
from ..spec import HOGSpec

_PARTS: tuple[Part, ...] = ("directed", "undirected", "texture")


@compiled
def _factors(histograms: Any, epsilon: Any, rows: int, cols: int) -> Any:
    """1 / √(energy + ε) of the four blocks of each cell, (B, 4, cells); beyond the grid the edge repeats."""
    batch, bins, cells = histograms.shape
    n = bins // 2
    energy = np.empty(cells, histograms.dtype)
    factors = np.empty((batch, 4, cells), histograms.dtype)
    for b in range(batch):
        energy[:] = 0
        for o in range(n):
            for i in range(cells):
                undirected = histograms[b, o, i] + histograms[b, o + n, i]
                energy[i] += undirected * undirected
        for y in range(rows + 1):
            up, down = max(y - 1, 0) * cols, min(y, rows - 1) * cols
            for x in range(cols + 1):
                left, right = max(x - 1, 0), min(x, cols - 1)
                block = (energy[up + left] + energy[up + right]) + (energy[down + left] + energy[down + right])
                factor = 1 / math.sqrt(block + epsilon)
                for k in range(4):  # this block is the up-left one of the cell to its down-right, and so on
                    row, col = y - k // 2, x - k % 2
                    if 0 <= row < rows and 0 <= col < cols:
                        factors[b, k, row * cols + col] = factor
    return factors


@compiled
def _normalize(
    histograms: Any, clip: Any, texture_scale: Any, half: Any, factors: Any, first: Any, wanted: Any, found: Any
) -> None:
    """Histograms (B, 2n, cells) to ``found`` (B, channels, cells), which is 0 before.

    The parts ``wanted``, three flags in the order of :data:`_PARTS`, have their channels from ``first`` on.
    """
    batch, bins, cells = histograms.shape
    n = bins // 2
    undirected = np.empty(cells, histograms.dtype)
    for b in range(batch):
        for o in range(bins if wanted[0] else 0):
            entries, to = histograms[b, o], found[b, o]
            for k in range(4):
                factor = factors[b, k]
                for i in range(cells):
                    entry = entries[i] * factor[i]
                    to[i] += half * (clip if entry > clip else entry)
        for o in range(n if wanted[1] or wanted[2] else 0):
            for i in range(cells):
                undirected[i] = histograms[b, o, i] + histograms[b, o + n, i]
            for k in range(4):
                factor = factors[b, k]
                if wanted[1]:
                    to = found[b, first[1] + o]
                    for i in range(cells):
                        entry = undirected[i] * factor[i]
                        to[i] += half * (clip if entry > clip else entry)
                if wanted[2]:
                    to = found[b, first[2] + k]
                    for i in range(cells):
                        entry = undirected[i] * factor[i]
                        to[i] += texture_scale * (clip if entry > clip else entry)


@compiled
def _normalize_adjoint(
    histograms: Any,
    clip: Any,
    texture_scale: Any,
    half: Any,
    factors: Any,
    first: Any,
    wanted: Any,
    given: Any,
    rows: int,
    cols: int,
    found: Any,
) -> None:
    """Adds to ``found`` (B, 2n, cells) what reaches the histograms from ``given`` (B, channels, cells)."""
    batch, bins, cells = histograms.shape
    n = bins // 2
    zero = half - half
    to_factors = np.empty((4, cells), histograms.dtype)
    to_energy, undirected = np.empty(cells, histograms.dtype), np.empty(cells, histograms.dtype)
    to_undirected, to_entries = np.empty(cells, histograms.dtype), np.empty(cells, histograms.dtype)
    for b in range(batch):
        to_factors[:] = 0
        for o in range(bins if wanted[0] else 0):
            entries, to_channel, to = histograms[b, o], given[b, o], found[b, o]
            for k in range(4):
                factor, to_factor = factors[b, k], to_factors[k]
                for i in range(cells):
                    product, share = entries[i] * factor[i], half * to_channel[i]
                    # at the clip itself, the mean of both sides
                    share = zero if product > clip else half * share if product == clip else share
                    to_factor[i] += share * entries[i]
                    to[i] += share * factor[i]
        for o in range(n if wanted[1] or wanted[2] else 0):
            for i in range(cells):
                undirected[i] = histograms[b, o, i] + histograms[b, o + n, i]
                to_undirected[i] = 0
            for k in range(4):
                to_entries[:] = 0
                if wanted[1]:
                    to_channel = given[b, first[1] + o]
                    for i in range(cells):
                        to_entries[i] += half * to_channel[i]
                if wanted[2]:
                    to_channel = given[b, first[2] + k]
                    for i in range(cells):
                        to_entries[i] += texture_scale * to_channel[i]
                factor, to_factor = factors[b, k], to_factors[k]
                for i in range(cells):
                    product, share = undirected[i] * factor[i], to_entries[i]
                    share = zero if product > clip else half * share if product == clip else share
                    to_factor[i] += share * undirected[i]
                    to_undirected[i] += share * factor[i]
            for k in range(2):
                to = found[b, o + k * n]
                for i in range(cells):
                    to[i] += to_undirected[i]
        to_energy[:] = 0
        for y in range(rows + 1):
            up, down = max(y - 1, 0) * cols, min(y, rows - 1) * cols
            for x in range(cols + 1):
                left, right = max(x - 1, 0), min(x, cols - 1)
                to_block = zero
                for k in range(4):
                    row, col = y - k // 2, x - k % 2
                    if 0 <= row < rows and 0 <= col < cols:
                        factor = factors[b, k, row * cols + col]
                        to_block -= to_factors[k, row * cols + col] * factor * factor * factor
                to_energy[up + left] += to_block
                to_energy[up + right] += to_block
                to_energy[down + left] += to_block
                to_energy[down + right] += to_block
        for o in range(n):
            one, opposite = found[b, o], found[b, o + n]
            for i in range(cells):
                to_both = (histograms[b, o, i] + histograms[b, o + n, i]) * to_energy[i]
                one[i] += to_both
                opposite[i] += to_both


class _FourBlocks(torch.autograd.Function):
    """Histograms (B, 2n, rows, cols) to (B, channels, rows, cols)."""

    @staticmethod
    def forward(ctx: Any, histograms: Tensor, scheme: FourBlockNorm) -> Tensor:
        batch, bins, ctx.rows, ctx.cols = histograms.shape
        ctx.entries = histograms.detach().contiguous().numpy().reshape(batch, bins, -1)
        dtype = ctx.entries.dtype.type
        ctx.factors = _factors(ctx.entries, dtype(scheme.epsilon), ctx.rows, ctx.cols)
        channels = [scheme.channels_of(part, bins) for part in _PARTS]
        first, wanted = np.cumsum([0, *channels[:-1]]), np.array(channels) > 0
        ctx.constants = dtype(scheme.clip), dtype(VLFEAT_TEXTURE), dtype(0.5), ctx.factors, first, wanted
        found = np.zeros((batch, sum(channels), ctx.rows * ctx.cols), dtype)
        _normalize(ctx.entries, *ctx.constants, found)
        return torch.from_numpy(found).view(batch, -1, ctx.rows, ctx.cols)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
        found = np.zeros_like(ctx.entries)
        to_channels = given.contiguous().flatten(2).numpy()
        _normalize_adjoint(ctx.entries, *ctx.constants, to_channels, ctx.rows, ctx.cols, found)
        return torch.from_numpy(found).view(*found.shape[:2], ctx.rows, ctx.cols), None


def four_block_norm(histograms: Tensor, scheme: FourBlockNorm) -> Tensor:
    """:func:`nablahog.hog.normalize.four_block_norm` on a CPU, differentiable once, in reverse mode."""
    found: Tensor = _FourBlocks.apply(histograms, scheme)  # type: ignore[no-untyped-call]
    return found


def supports(spec: HOGSpec) -> bool:
    """Whether these loops do what the plain steps do for the dialect."""
    scheme = spec.normalizer
    if spec.colours > 1:
        return False
    if not isinstance(scheme, FourBlockNorm):
        return isinstance(scheme, GlobalNorm)
    plain = spec.signed and scheme.texture == "vlfeat" and scheme.outside == "repeat" and not scheme.floor
    return plain and set(scheme.parts) <= set(_PARTS)


def normalize(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """:func:`nablahog.hog.normalize.normalize` on a CPU, differentiable once, in reverse mode."""
    assert isinstance(spec.normalizer, FourBlockNorm | GlobalNorm)
    if isinstance(spec.normalizer, GlobalNorm):
        return global_norm(histograms, spec.normalizer)  # a few passes over cells, no loop of its own would be faster
    return four_block_norm(histograms, spec.normalizer)
