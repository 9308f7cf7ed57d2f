"""Eq. 1-6 in one pass over gray images, and their adjoint in another: images -> cell histograms.

A pixel votes into two orientation bins of two rows by two columns of cells.  Dense over bins, as in the plain steps,
that takes some thirty passes over planes in memory; here each pixel adds its votes to a row of cells that stays in the
processor's cache.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ...compile import compiled
from ..orientation import hard_directions, vanishing
from ..pooling import pooling_matrix
from ..spec import HOGSpec

_BORDERS = {"reflect": 0, "ignore": 0, "replicate": 1, "zero": 2}

# atan(t) / π for t in 0…1, within 8e-8: an odd polynomial, so that right angles stay exactly on their bin centres
_ARCTANGENT = np.array(
    [0.3183086485, -0.1060524763, 0.06305023492, -0.04212303499, 0.02534499976, -0.01069655349, 0.002168260411],
    np.float32,
)


@compiled
def _gradient(image: Any, scale: Any, border: int, gx: Any, gy: Any) -> None:
    """Eq. 1-2: an image (H, W), times ``scale``, to its gradient."""
    height, width = image.shape
    for y in range(height):
        for x in range(1, width - 1):
            gx[y, x] = scale * (image[y, x + 1] - image[y, x - 1])
        gx[y, 0] = gx[y, width - 1] = scale * (image[y, 0] - image[y, 0])
        if width > 1 and border > 0:
            gx[y, 0] = scale * (image[y, 1] - image[y, 0] if border == 1 else image[y, 1])
            gx[y, width - 1] = scale * (
                image[y, width - 1] - image[y, width - 2] if border == 1 else -image[y, width - 2]
            )
    for y in range(1, height - 1):
        for x in range(width):
            gy[y, x] = scale * (image[y + 1, x] - image[y - 1, x])
    for x in range(width):
        gy[0, x] = gy[height - 1, x] = scale * (image[0, x] - image[0, x])
        if height > 1 and border > 0:
            gy[0, x] = scale * (image[1, x] - image[0, x] if border == 1 else image[1, x])
            gy[height - 1, x] = scale * (
                image[height - 1, x] - image[height - 2, x] if border == 1 else -image[height - 2, x]
            )


@compiled
def _gradient_adjoint(to_gx: Any, to_gy: Any, scale: Any, border: int, image: Any) -> None:
    """Adds to ``image`` what reaches it from its gradient."""
    height, width = image.shape
    for y in range(height):
        for x in range(1, width - 1):
            image[y, x + 1] += scale * to_gx[y, x]
        for x in range(1, width - 1):
            image[y, x - 1] -= scale * to_gx[y, x]
        if width > 1 and border > 0:
            image[y, 1] += scale * to_gx[y, 0]
            image[y, width - 2] -= scale * to_gx[y, width - 1]
            if border == 1:
                image[y, 0] -= scale * to_gx[y, 0]
                image[y, width - 1] += scale * to_gx[y, width - 1]
    for y in range(1, height - 1):
        for x in range(width):
            image[y + 1, x] += scale * to_gy[y, x]
            image[y - 1, x] -= scale * to_gy[y, x]
    if height > 1 and border > 0:
        for x in range(width):
            image[1, x] += scale * to_gy[0, x]
            image[height - 2, x] -= scale * to_gy[height - 1, x]
            if border == 1:
                image[0, x] -= scale * to_gy[0, x]
                image[height - 1, x] += scale * to_gy[height - 1, x]


@compiled
def _linear_single(
    gx: Any,
    gy: Any,
    tiny: Any,
    per_half_turn: Any,
    offset: Any,
    bins: Any,
    arctangent: Any,
    m: Any,
    nearest: Any,
    r: Any,
) -> None:
    """Eq. 2-4 for gradients (H, W) in float32: magnitudes, nearest bins, and the rest of the way in bins.

    Without branches, so that several pixels go at a time.
    """
    a0, a1, a2, a3, a4, a5, a6 = arctangent
    one, half, zero = arctangent.dtype.type(1), arctangent.dtype.type(0.5), arctangent.dtype.type(0)
    quarter = half * half
    for y in range(gx.shape[0]):
        for x in range(gx.shape[1]):
            u, v = gx[y, x], gy[y, x]
            squared = u * u + v * v
            nothing = squared < tiny
            m[y, x] = zero if nothing else math.sqrt(squared)
            au, av = abs(u), abs(v)
            steep = av > au
            small = au if steep else av
            large = av if steep else au
            t = zero if nothing else small / (one if nothing else large)
            s = t * t
            turn = t * (a0 + s * (a1 + s * (a2 + s * (a3 + s * (a4 + s * (a5 + s * a6))))))
            turn = quarter if small == large else turn  # which may be a bin centre, too
            turn = half - turn if steep else turn
            turn = one - turn if u < zero else turn
            turn = -turn if v < zero else turn
            position = (zero if nothing else turn) * per_half_turn - offset
            whole = np.rint(position)
            r[y, x] = position - whole
            whole = whole + bins if whole < zero else whole
            whole = whole + bins if whole < zero else whole
            whole = whole - bins if whole >= bins else whole
            whole = whole if whole >= zero else zero  # of NaN
            nearest[y, x] = np.int32(whole)


@compiled
def _linear_double(
    gx: Any,
    gy: Any,
    tiny: Any,
    per_half_turn: Any,
    offset: Any,
    bins: Any,
    arctangent: Any,
    m: Any,
    nearest: Any,
    r: Any,
) -> None:
    """The same in float64."""
    for y in range(gx.shape[0]):
        for x in range(gx.shape[1]):
            u, v = gx[y, x], gy[y, x]
            squared = u * u + v * v
            nothing = squared < tiny
            m[y, x] = 0.0 if nothing else math.sqrt(squared)
            position = (0.0 if nothing else math.atan2(v, u) / math.pi) * per_half_turn - offset
            whole = np.rint(position)
            r[y, x] = position - whole
            whole %= bins
            nearest[y, x] = np.int32(whole if whole >= 0 else 0.0)


@compiled
def _hard(gx: Any, gy: Any, tiny: Any, directions: Any, signed: bool, m: Any, nearest: Any, r: Any) -> None:
    """The same by the largest |dot product| with ``directions`` (cos, sin) (2, axes), the first on ties; no rest."""
    axes = directions.shape[1]
    for y in range(gx.shape[0]):
        for x in range(gx.shape[1]):
            u, v = gx[y, x], gy[y, x]
            squared = u * u + v * v
            m[y, x] = squared * 0 if squared < tiny else math.sqrt(squared)
            best, most, sign = 0, u * 0 - 1, False
            for k in range(axes):
                dot = u * directions[0, k] + v * directions[1, k]
                if abs(dot) > most:
                    best, most, sign = k, abs(dot), dot < 0
            nearest[y, x] = best + axes if signed and sign else best
            r[y, x] = 0


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
    """Eq. 3-6: votes of pixels (H, W) into ``histograms`` (rows, cols, bins), which are 0 before."""
    rows, cols, bins = histograms.shape
    height, width = m.shape
    # a column more for weights of 0, and a bin more at each end for the neighbours of the first and the last
    of_row = np.empty((cols + 1, bins + 2), m.dtype)
    for y in range(height):
        of_row[:] = 0
        for x in range(width):
            bin_ = np.uintp(nearest[y, x]) + np.uintp(1)
            other = bin_ + np.uintp(1) if r[y, x] > 0 else bin_ - np.uintp(1)
            far = m[y, x] * abs(r[y, x])
            near = m[y, x] - far
            col = np.uintp(first_col[x])
            right_col = col + np.uintp(1)
            left, right = col_weights[0, x], col_weights[1, x]
            of_row[col, bin_] += left * near
            of_row[col, other] += left * far
            of_row[right_col, bin_] += right * near
            of_row[right_col, other] += right * far
        for col in range(cols):
            of_row[col, bins] += of_row[col, 0]
            of_row[col, 1] += of_row[col, bins + 1]
        for k in range(2):
            row, weight = first_row[y] + k, row_weights[k, y]
            if row < rows:
                for col in range(cols):
                    for bin_ in range(bins):
                        histograms[row, col, bin_] += weight * of_row[col, bin_ + 1]


@compiled
def _pool_adjoint(
    given: Any,
    gx: Any,
    gy: Any,
    m: Any,
    nearest: Any,
    r: Any,
    slope: Any,
    first_row: Any,
    row_weights: Any,
    first_col: Any,
    col_weights: Any,
) -> None:
    """Replaces the gradient (H, W) by what reaches it from ``given`` (rows, cols, bins), of the histograms.

    ``slope`` is how many bins a radian has; 0 for hard votes, which know the magnitude only.
    """
    rows, cols, bins = given.shape
    height, width = m.shape
    of_row = np.zeros((cols + 1, bins + 2), m.dtype)
    for y in range(height):
        row = first_row[y]
        below = min(row + 1, rows - 1)
        up, down = row_weights[0, y], row_weights[1, y]
        for col in range(cols):
            for bin_ in range(bins):
                of_row[col, bin_ + 1] = up * given[row, col, bin_] + down * given[below, col, bin_]
            of_row[col, 0], of_row[col, bins + 1] = of_row[col, bins], of_row[col, 1]
        for x in range(width):
            size, rest = m[y, x], r[y, x]
            if size == 0:  # the tip of a cone
                gx[y, x] = gy[y, x] = size
                continue
            bin_ = np.uintp(nearest[y, x]) + np.uintp(1)
            after, before = bin_ + np.uintp(1), bin_ - np.uintp(1)
            col = np.uintp(first_col[x])
            right_col = col + np.uintp(1)
            left, right = col_weights[0, x], col_weights[1, x]
            here = left * of_row[col, bin_] + right * of_row[right_col, bin_]
            other = after if rest > 0 else before
            there = left * of_row[col, other] + right * of_row[right_col, other]
            along = here + abs(rest) * (there - here)
            change = there - here if rest > 0 else here - there
            if rest == 0:  # on a bin centre, the mean of both sides
                change = (left * of_row[col, after] + right * of_row[right_col, after] - there) / 2
            across = slope * change
            u, v = gx[y, x], gy[y, x]
            gx[y, x] = (along * u - across * v) / size
            gy[y, x] = (along * v + across * u) / size


@lru_cache(maxsize=64)
def _two_cells(pixels: int, cell: int, cells: int, ignore_ring: bool, dtype: torch.dtype) -> tuple[Any, Any]:
    """Of :func:`..pooling.pooling_matrix`: the first cell of each pixel (pixels,), and its and the next's weight."""
    matrix = pooling_matrix(pixels, cell, cells, ignore_ring, torch.empty(0, dtype=dtype)).numpy()
    first = (matrix > 0).argmax(axis=0)
    padded = np.concatenate([matrix, np.zeros_like(matrix[:1])])
    pixel = np.arange(pixels)
    return first, np.stack([padded[first, pixel], padded[first + 1, pixel]])


class _Cells(torch.autograd.Function):
    """Images (B, 1, H, W) to cell histograms (B, bins, rows, cols)."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, spec: HOGSpec) -> Tensor:
        batch, _, height, width = images.shape
        rows, cols = spec.grid(height, width)
        ring = spec.border == "ignore"
        ctx.pooling = (
            *_two_cells(height, spec.cell_size[0], rows, ring, images.dtype),
            *_two_cells(width, spec.cell_size[1], cols, ring, images.dtype),
        )
        pixels = images.detach().contiguous().numpy()[:, 0]
        dtype = pixels.dtype.type
        scale, tiny = dtype(spec.value_range), dtype(vanishing(images.dtype))
        gx, gy, m, r = (np.empty_like(pixels) for _ in range(4))
        nearest = np.empty(pixels.shape, np.int32)
        found = np.zeros((batch, rows, cols, spec.bins), dtype)
        for image in range(batch):
            gradient = gx[image], gy[image]
            votes = m[image], nearest[image], r[image]
            _gradient(pixels[image], scale, _BORDERS[spec.border], *gradient)
            if spec.vote == "hard":
                _hard(*gradient, tiny, hard_directions(spec).astype(dtype), spec.signed, *votes)
            else:
                linear = _linear_single if dtype is np.float32 else _linear_double
                turns = dtype(spec.bins * math.pi / spec.period), dtype(spec.bin_offset), dtype(spec.bins)
                linear(*gradient, tiny, *turns, _ARCTANGENT, *votes)
            _pool(*votes, *ctx.pooling, found[image])
        ctx.spec, ctx.gradient, ctx.votes = spec, (gx, gy), (m, nearest, r)
        return torch.from_numpy(found).permute(0, 3, 1, 2)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
        spec: HOGSpec = ctx.spec
        to_histograms = given.permute(0, 2, 3, 1).contiguous().numpy()
        dtype = to_histograms.dtype.type
        slope = dtype(0 if spec.vote == "hard" else spec.bins / spec.period)
        found = np.zeros_like(ctx.gradient[0])
        for image, to_image in enumerate(found):
            gx, gy = (plane[image].copy() for plane in ctx.gradient)
            votes = (plane[image] for plane in ctx.votes)
            _pool_adjoint(to_histograms[image], gx, gy, *votes, slope, *ctx.pooling)
            _gradient_adjoint(gx, gy, dtype(spec.value_range), _BORDERS[spec.border], to_image)
        return torch.from_numpy(found).unsqueeze(1), None


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """:func:`nablahog.hog.descriptor.histograms` of gray images on a CPU.

    Args:
        images: (B, 1, H, W), float32 or float64, in 0…1.
        spec: any dialect; with one channel, ``colour`` makes no difference.

    Returns:
        (B, bins, rows, cols), differentiable once, in reverse mode.
    """
    found: Tensor = _Cells.apply(images, spec)  # type: ignore[no-untyped-call]
    return found
