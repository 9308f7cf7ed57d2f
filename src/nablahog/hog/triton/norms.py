"""The normalisers of a whole image, Eq. 7, and of each cell, in Triton.

Histograms are (images, rows, cols, bins), ``stride`` from image to image; what is computed from them lies without gaps.
The derivative of either is a symmetric matrix: its vjp is its jvp.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import quotient, root


@triton.jit
def places(count, area, TILE: tl.constexpr):
    """The cells of this program: which image, which place in it, and whether there are so many."""
    index = tl.program_id(0).to(tl.int64) * TILE + tl.arange(0, TILE)
    return index // area, index % area, index < count


@triton.jit
def sums_kernel(x, y, out, numbers, share, parts, stride, other_stride, TILE: tl.constexpr):
    """⟨x, x⟩ and ⟨x, y⟩ of each part of each image, (images, parts, 2) float64: ``share`` numbers each."""
    REAL: tl.constexpr = x.dtype.element_ty
    program = tl.program_id(0)
    image, part = (program // parts).to(tl.int64), program % parts
    energy, product = tl.zeros([TILE], REAL), tl.zeros([TILE], REAL)
    for start in range(part * share, tl.minimum((part + 1) * share, numbers), TILE):
        k = start + tl.arange(0, TILE)
        own = tl.load(x + image * stride + k, mask=k < numbers, other=0)
        other = tl.load(y + image * other_stride + k, mask=k < numbers, other=0)
        energy += own * own
        product += own * other
    tl.store(out + 2 * program, tl.sum(energy.to(tl.float64), 0))
    tl.store(out + 2 * program + 1, tl.sum(product.to(tl.float64), 0))


@triton.jit
def global_norm_kernel(
    x,
    y,
    sums,
    flags,
    out,
    numbers,
    share,
    parts,
    stride,
    flag_stride,
    EPSILON: tl.constexpr,
    ROBUST: tl.constexpr,
    DERIVATIVE: tl.constexpr,
    TILE: tl.constexpr,
    PARTS: tl.constexpr,
):
    """Eq. 7, f · x, or f · y + f' · ⟨x, y⟩ · x."""
    REAL: tl.constexpr = out.dtype.element_ty
    program = tl.program_id(0)
    image, part = (program // parts).to(tl.int64), program % parts
    k = tl.arange(0, PARTS)
    of_image = sums + 2 * (image * parts + k)
    energy = tl.sum(tl.load(of_image, mask=k < parts, other=0), 0)
    product = tl.sum(tl.load(of_image + 1, mask=k < parts, other=0), 0)
    length = tl.sqrt(energy)
    factor = 1 / tl.sqrt(energy + EPSILON * EPSILON if ROBUST else length + EPSILON)
    if ROBUST:
        slope = -factor * factor * factor * product
    else:
        slope = -0.5 * factor * factor * factor * product
        slope = tl.where(length > 0, slope / tl.where(length > 0, length, 1.0), 0.0)
    if tl.load(flags + image * flag_stride) != 0:
        factor, slope = factor * float("nan"), slope * float("nan")
    for start in range(part * share, tl.minimum((part + 1) * share, numbers), TILE):
        place = start + tl.arange(0, TILE)
        own = tl.load(x + image * stride + place, mask=place < numbers, other=0)
        value = own * factor.to(REAL)
        if DERIVATIVE:
            other = tl.load(y + image * numbers + place, mask=place < numbers, other=0)
            value = other * factor.to(REAL) + own * slope.to(REAL)
        tl.store(out + image * numbers + place, value, mask=place < numbers)


@triton.jit
def cell_norm_kernel(
    x,
    y,
    flags,
    out,
    count,
    area,
    stride,
    flag_stride,
    COUNT: tl.constexpr,
    EPSILON: tl.constexpr,
    DERIVATIVE: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """v / max(‖v‖, ε), or its derivative times y; where a cell is exactly as long as ε, the mean of both sides."""
    image, place, there = places(count, area, TILE)
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < COUNT)
    own = tl.load(x + (image * stride + place * COUNT)[:, None] + k, mask=some, other=0)
    norm = root(tl.sum(own * own, 1))
    length = tl.where(norm <= EPSILON, EPSILON, norm)  # NaN stays
    at = (image * area + place)[:, None] * COUNT + k
    inverse = quotient(tl.full([TILE], 1, own.dtype), length)[:, None]
    if DERIVATIVE:
        other = tl.load(y + at, mask=some, other=0)
        moves = tl.where(norm > EPSILON, 1.0, tl.where(norm == EPSILON, 0.5, 0.0))
        along = (moves * tl.sum(own * other, 1))[:, None] * inverse * inverse
        value = (other - along * own) * inverse
    else:
        value = own * inverse
    spoilt = tl.load(flags + image * flag_stride, mask=there, other=0) != 0
    tl.store(out + at, tl.where(spoilt[:, None], float("nan"), value), mask=some)
