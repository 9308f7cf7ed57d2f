"""Eq. 1-6 in one pass over gray images, and their adjoint in another: images -> cell histograms.

A pixel votes into two orientation bins of two rows by two columns of cells.  Dense over bins, as in the plain steps,
that takes some thirty passes over planes in memory; here each pixel adds its votes to a row of cells that stays in the
processor's cache, and a pixel without a gradient, as most are in a rendering, is passed over.  The adjoint computes the
votes once more: for a few images at a time that takes less than to fetch them from memory.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ...compile import compiled
from ..orientation import bin_angles
from ..pooling import pooling_matrices
from ..poolings import BlockCells
from ..spec import HOGSpec
from .votes import BORDERS, Voter


@compiled
def _pool(
    m: Any,
    nearest: Any,
    r: Any,
    first_row: Any,
    row_weights: Any,
    first_col: Any,
    col_weights: Any,
    histograms: Any,
) -> None:
    """Eq. 3-6: votes of pixels (B, H, W) to ``histograms`` (B, rows, cols, bins)."""
    batch, rows, cols, bins = histograms.shape
    height, width = m.shape[1:]
    # a row and a column more for weights of 0, and a bin more at each end for the neighbours of the first and the last
    cell = bins + 2
    of_row = np.empty((cols + 1) * cell, m.dtype)
    of_image = np.empty((rows + 1, of_row.size), m.dtype)
    for b in range(batch):
        of_image[:] = 0
        for y in range(height):
            of_row[:] = 0
            sizes, rests, nearests = m[b, y], r[b, y], nearest[b, y]
            for x in range(width):
                size, rest = sizes[x], rests[x]
                if size == 0:
                    continue
                near = np.uintp(first_col[x] * cell + nearests[x] + 1)
                far = near + np.uintp(1) if rest > 0 else near - np.uintp(1)
                to_far = size * abs(rest)
                to_near = size - to_far
                left, right = col_weights[0, x], col_weights[1, x]
                of_row[near] += left * to_near
                of_row[far] += left * to_far
                of_row[near + np.uintp(cell)] += right * to_near
                of_row[far + np.uintp(cell)] += right * to_far
            up, down = row_weights[0, y], row_weights[1, y]
            above, below = of_image[first_row[y]], of_image[first_row[y] + 1]
            for k in range(of_row.size):
                above[k] += up * of_row[k]
                below[k] += down * of_row[k]
        for row in range(rows):
            for col in range(cols):
                votes = of_image[row, col * cell : (col + 1) * cell]
                for k in range(bins):
                    histograms[b, row, col, k] = votes[k + 1]
                histograms[b, row, col, bins - 1] += votes[0]
                histograms[b, row, col, 0] += votes[bins + 1]


@compiled
def _pool_adjoint(
    given: Any,
    gx: Any,
    gy: Any,
    m: Any,
    nearest: Any,
    r: Any,
    slope: Any,
    half: Any,
    first_row: Any,
    row_weights: Any,
    first_col: Any,
    col_weights: Any,
) -> None:
    """Replaces the gradients (B, H, W) by what reaches them from ``given`` (B, rows, cols, bins), of the histograms.

    ``slope`` is how many bins a radian has; 0 for hard votes, which know the magnitude only.
    """
    batch, rows, cols, bins = given.shape
    height, width = m.shape[1:]
    cell = bins + 2  # padded as in _pool
    next_cell = np.uintp(cell)
    of_row = np.empty((cols + 1) * cell, m.dtype)
    of_image = np.zeros((rows + 1, of_row.size), m.dtype)
    for b in range(batch):
        for row in range(rows):
            for col in range(cols):
                votes = of_image[row, col * cell : (col + 1) * cell]
                for k in range(bins):
                    votes[k + 1] = given[b, row, col, k]
                votes[0], votes[bins + 1] = votes[bins], votes[1]
        for y in range(height):
            up, down = row_weights[0, y], row_weights[1, y]
            above, below = of_image[first_row[y]], of_image[first_row[y] + 1]
            for k in range(of_row.size):
                of_row[k] = up * above[k] + down * below[k]
            sizes, rests, nearests, us, vs = m[b, y], r[b, y], nearest[b, y], gx[b, y], gy[b, y]
            for x in range(width):
                size, rest = sizes[x], rests[x]
                if size == 0:  # the tip of a cone
                    us[x] = vs[x] = size
                    continue
                near = np.uintp(first_col[x] * cell + nearests[x] + 1)
                after, before = near + np.uintp(1), near - np.uintp(1)
                left, right = col_weights[0, x], col_weights[1, x]
                here = left * of_row[near] + right * of_row[near + next_cell]
                ahead = left * of_row[after] + right * of_row[after + next_cell] - here
                behind = here - (left * of_row[before] + right * of_row[before + next_cell])
                change = ahead if rest > 0 else behind
                along = here + rest * change
                if rest == 0:  # on a bin centre, the mean of both sides
                    change = half * (ahead + behind)
                along, across = along / size, slope * change / size
                u, v = us[x], vs[x]
                us[x] = along * u - across * v
                vs[x] = along * v + across * u


def _two_cells(matrix: Any) -> tuple[Any, Any]:
    """Of a matrix (cells, pixels): the first cell of each pixel (pixels,), and its and the next's weight."""
    first = (matrix > 0).argmax(axis=0)
    padded = np.concatenate([matrix, np.zeros_like(matrix[:1])])
    pixel = np.arange(matrix.shape[1])
    return first, np.stack([padded[first, pixel], padded[first + 1, pixel]])


@lru_cache(maxsize=64)
def _pooling(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> tuple[Any, ...]:
    """The first row of each row of pixels with both weights, and the same of columns."""
    by_row, by_col = pooling_matrices(spec, height, width, torch.empty(0, dtype=dtype))
    return *_two_cells(by_row.numpy()), *_two_cells(by_col.numpy())


class _Cells(torch.autograd.Function):
    """Images (B, 1, H, W) to cell histograms (B, bins, rows, cols)."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, spec: HOGSpec) -> Tensor:
        ctx.save_for_backward(images)
        ctx.spec = spec
        batch, _, height, width = images.shape
        pooling = _pooling(spec, height, width, images.dtype)
        pixels = images.detach().contiguous().numpy()[:, 0]
        found = np.empty((batch, *spec.cells(height, width), spec.bins), pixels.dtype)
        for few, _, votes in Voter(spec, pixels):
            _pool(*votes, *pooling, found[few])
        return torch.from_numpy(found).permute(0, 3, 1, 2)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
        (images,), spec = ctx.saved_tensors, ctx.spec
        height, width = images.shape[2:]
        pooling = _pooling(spec, height, width, images.dtype)
        pixels = images.contiguous().numpy()[:, 0]
        to_histograms = given.permute(0, 2, 3, 1).contiguous().numpy()
        dtype = pixels.dtype.type
        slope = dtype(0 if spec.vote == "hard" else spec.bins / spec.period)
        found = np.zeros_like(pixels)
        for few, gradient, votes in (voter := Voter(spec, pixels)):
            _pool_adjoint(to_histograms[few], *gradient, *votes, slope, dtype(0.5), *pooling)
            voter.add_to_images(*gradient, found[few])
        return torch.from_numpy(found).unsqueeze(1), None


def supports(spec: HOGSpec) -> bool:
    """Whether these loops do what the plain steps do for the dialect."""
    return (
        spec.border in BORDERS
        and spec.colour != "separate"
        and not isinstance(spec.pooling, BlockCells)
        and (spec.gamma, spec.mask, spec.angle, spec.counterclockwise) == ("none", "central", "exact", False)
        and (spec.vote == "linear" or ((spec.boundary, spec.derivative) == ("first", "own") and not _ties(spec)))
    )


def _ties(spec: HOGSpec) -> bool:
    """Whether diagonal gradients are exactly between two bins, of which fused products and sums prefer one."""
    boundaries = np.degrees(bin_angles(spec)) + np.degrees(spec.period) / spec.bins / 2
    return bool((np.abs(boundaries % 90 - 45) < 1e-9).any())


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """:func:`nablahog.hog.descriptor.histograms` of gray images on a CPU.

    Args:
        images: (B, 1, H, W), float32 or float64, in 0…1.
        spec: a dialect that :func:`supports`; with one channel, ``colour`` makes no difference.

    Returns:
        (B, bins, rows, cols), differentiable once, in reverse mode.
    """
    found: Tensor = _Cells.apply(images, spec)  # type: ignore[no-untyped-call]
    return found
