"""The normaliser of each cell by the energy around it, in Triton.

Weights are exp(-d² / 2σ²) along either axis, up to ``REACH`` cells away; ``weights`` (REACH + 1,) holds them.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import quotient, root
from .norms import places


@triton.jit
def products_kernel(
    x, y, out, count, area, stride, other_stride, COUNT: tl.constexpr, TILE: tl.constexpr, BINS: tl.constexpr
):
    """⟨x, x⟩ and ⟨x, y⟩ of each cell, (images, rows, cols, 2)."""
    image, place, there = places(count, area, TILE)
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < COUNT)
    own = tl.load(x + (image * stride + place * COUNT)[:, None] + k, mask=some, other=0)
    at = image * area + place
    other = tl.load(y + (image * other_stride + place * COUNT)[:, None] + k, mask=some, other=0)
    tl.store(out + 2 * at, tl.sum(own * own, 1), mask=there)
    tl.store(out + 2 * at + 1, tl.sum(own * other, 1), mask=there)


@triton.jit
def _around(numbers, which: tl.constexpr, image, row, col, there, rows, cols, weights, REACH: tl.constexpr):
    """The weighted sum of a number of each cell around."""
    total = tl.zeros(image.shape, numbers.dtype.element_ty)
    for a in range(-REACH, REACH + 1):
        for b in range(-REACH, REACH + 1):
            y, z = row + a, col + b
            inside = there & (y >= 0) & (y < rows) & (z >= 0) & (z < cols)
            weight = tl.load(weights + tl.abs(a)) * tl.load(weights + tl.abs(b))
            cell = (image * rows + y) * cols + z
            total += weight * tl.load(numbers + 2 * cell + which, mask=inside, other=0)
    return total


@triton.jit
def window_factors_kernel(
    products, out, weights, count, rows, cols, EPSILON: tl.constexpr, REACH: tl.constexpr, TILE: tl.constexpr
):
    """The factor f of each cell, and of its vjp -f³⟨x, y⟩, (images, rows, cols, 2)."""
    image, place, there = places(count, rows * cols, TILE)
    energy = _around(products, 0, image, place // cols, place % cols, there, rows, cols, weights, REACH)
    factor = quotient(tl.full([1], 1, energy.dtype), root(energy + EPSILON * EPSILON))
    at = 2 * (image * (rows * cols) + place)
    product = tl.load(products + at + 1, mask=there, other=0)
    tl.store(out + at, factor, mask=there)
    tl.store(out + at + 1, -factor * factor * factor * product, mask=there)


@triton.jit
def window_norm_kernel(
    x,
    y,
    products,
    factors,
    flags,
    out,
    weights,
    count,
    rows,
    cols,
    stride,
    flag_stride,
    COUNT: tl.constexpr,
    DERIVATIVE: tl.constexpr,
    TRANSPOSED: tl.constexpr,
    REACH: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """f · x; or its jvp f · y - f³ Σ w⟨x, y⟩ · x; or, TRANSPOSED, its vjp f · y + Σ w s · x, with s of cells around."""
    image, place, there = places(count, rows * cols, TILE)
    row, col = place // cols, place % cols
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < COUNT)
    own = tl.load(x + (image * stride + place * COUNT)[:, None] + k, mask=some, other=0)
    cell = image * (rows * cols) + place
    factor = tl.load(factors + 2 * cell, mask=there, other=0)
    value = own * factor[:, None]
    if DERIVATIVE:
        other = tl.load(y + cell[:, None] * COUNT + k, mask=some, other=0)
        if TRANSPOSED:
            slope = _around(factors, 1, image, row, col, there, rows, cols, weights, REACH)
        else:
            around = _around(products, 1, image, row, col, there, rows, cols, weights, REACH)
            slope = -factor * factor * factor * around
        value = other * factor[:, None] + own * slope[:, None]
    spoilt = tl.load(flags + image * flag_stride, mask=there, other=0) != 0
    tl.store(out + cell[:, None] * COUNT + k, tl.where(spoilt[:, None], float("nan"), value), mask=some)
