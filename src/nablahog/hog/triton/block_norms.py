"""The normaliser of rectangular blocks of cells in Triton: each program owns some blocks, or in the vjp some cells."""

from __future__ import annotations

from typing import NamedTuple

import triton
import triton.language as tl

from .gradients import quotient, root
from .norms import places


class Blocks(NamedTuple):
    """What the kernels know of a ``BlockNorm``."""

    high: int  # cells
    wide: int
    down: int  # cells from block to block
    across: int
    bins: int
    size: int  # numbers of a block
    L1: bool
    sqrt: bool
    hys: bool
    epsilon: float
    epsilon_again: float
    epsilon_outside_root: bool
    clip: float


@triton.jit
def _factor(energy, EPSILON: tl.constexpr, OUTSIDE: tl.constexpr):
    """The factor f of L2: f · x."""
    length = root(energy) + EPSILON if OUTSIDE else root(energy + EPSILON * EPSILON)
    return quotient(tl.full([1], 1, energy.dtype), length)


@triton.jit
def _slope(energy, factor, product, OUTSIDE: tl.constexpr):
    """The coefficient s of L2's derivative f · y - s · x, with ``product`` ⟨x, y⟩."""
    if OUTSIDE:
        some = energy > 0
        slope = tl.where(some, quotient(factor * factor * product, root(tl.where(some, energy, 1.0))), 0.0)
    else:
        slope = factor * factor * factor * product
    return slope


@triton.jit
def _first_factor(x, SCHEME: tl.constexpr):
    """That of the first normalisation of blocks (n, size), and their sums of squares, or sums."""
    if SCHEME.L1:
        total = tl.sum(x, 1)
        factor = quotient(tl.full([1], 1, total.dtype), total + SCHEME.epsilon)
    else:
        total = tl.sum(x * x, 1)
        factor = _factor(total, SCHEME.epsilon, SCHEME.epsilon_outside_root)
    return total, factor


@triton.jit
def _clipped(u, SCHEME: tl.constexpr):
    return tl.where(u > SCHEME.clip, SCHEME.clip, u)  # NaN stays


@triton.jit
def _passes(u, SCHEME: tl.constexpr):
    """The derivative of the clip; where equal, the mean of both sides."""
    return tl.where(u < SCHEME.clip, 1.0, tl.where(u == SCHEME.clip, 0.5, 0.0)).to(u.dtype)


@triton.jit
def _root_slope(u):
    """The derivative of √, 0 at 0."""
    some = u != 0
    return tl.where(some, quotient(tl.full([1, 1], 0.5, u.dtype), root(tl.where(some, u, 1.0))), 0.0)


@triton.jit
def _read_blocks(x, image, place, there, stride, cols, grid_cols, SCHEME: tl.constexpr, SIZE: tl.constexpr):
    """Blocks (n, size) of histograms, by rows of cells."""
    k = tl.arange(0, SIZE)[None, :]
    cell = k // SCHEME.bins
    row = (place // grid_cols)[:, None] * SCHEME.down + cell // SCHEME.wide
    col = (place % grid_cols)[:, None] * SCHEME.across + cell % SCHEME.wide
    at = (image * stride)[:, None] + (row * cols + col) * SCHEME.bins + k % SCHEME.bins
    return tl.load(x + at, mask=there[:, None] & (k < SCHEME.size), other=0)


@triton.jit
def block_norm_kernel(
    x,
    tangents,
    flags,
    out,
    count,
    area,
    grid_cols,
    cols,
    stride,
    tangent_stride,
    flag_stride,
    SCHEME: tl.constexpr,
    TANGENTS: tl.constexpr,
    TILE: tl.constexpr,
    SIZE: tl.constexpr,
):
    """Blocks (images, rows, cols, size) of histograms, or their tangents."""
    image, place, there = places(count, area, TILE)
    own = _read_blocks(x, image, place, there, stride, cols, grid_cols, SCHEME, SIZE)
    total, factor = _first_factor(own, SCHEME)
    u = own * factor[:, None]
    value = u
    if TANGENTS:
        change = _read_blocks(tangents, image, place, there, tangent_stride, cols, grid_cols, SCHEME, SIZE)
        if SCHEME.L1:
            slope = factor * factor * tl.sum(change, 1)
        else:
            slope = _slope(total, factor, tl.sum(own * change, 1), SCHEME.epsilon_outside_root)
        value = factor[:, None] * change - slope[:, None] * own
    if SCHEME.sqrt:
        value = value * _root_slope(u) if TANGENTS else root(tl.where(u == 0, 0.0, u))
    if SCHEME.hys:
        c = _clipped(u, SCHEME)
        energy = tl.sum(c * c, 1)
        again = _factor(energy, SCHEME.epsilon_again, SCHEME.epsilon_outside_root)
        if TANGENTS:
            moved = _passes(u, SCHEME) * value
            slope = _slope(energy, again, tl.sum(c * moved, 1), SCHEME.epsilon_outside_root)
            value = again[:, None] * moved - slope[:, None] * c
        else:
            value = c * again[:, None]
    k = tl.arange(0, SIZE)[None, :]
    spoilt = tl.load(flags + image * flag_stride, mask=there, other=0) != 0
    value = tl.where(spoilt[:, None], float("nan"), value)
    at = (image * area + place)[:, None] * SCHEME.size + k
    tl.store(out + at, value, mask=there[:, None] & (k < SCHEME.size))


@triton.jit
def block_numbers_kernel(
    x, grad, out, count, area, grid_cols, cols, stride, SCHEME: tl.constexpr, TILE: tl.constexpr, SIZE: tl.constexpr
):
    """Of each block the four numbers of its vjp: factor and slope of either normalisation."""
    image, place, there = places(count, area, TILE)
    own = _read_blocks(x, image, place, there, stride, cols, grid_cols, SCHEME, SIZE)
    k = tl.arange(0, SIZE)[None, :]
    at = image * area + place
    of_output = tl.load(grad + at[:, None] * SCHEME.size + k, mask=there[:, None] & (k < SCHEME.size), other=0)
    total, factor = _first_factor(own, SCHEME)
    u = own * factor[:, None]
    again, slope_again = tl.full([TILE], 1, own.dtype), tl.zeros([TILE], own.dtype)
    if SCHEME.hys:
        c = _clipped(u, SCHEME)
        energy = tl.sum(c * c, 1)
        again = _factor(energy, SCHEME.epsilon_again, SCHEME.epsilon_outside_root)
        slope_again = _slope(energy, again, tl.sum(c * of_output, 1), SCHEME.epsilon_outside_root)
        of_output = _passes(u, SCHEME) * (again[:, None] * of_output - slope_again[:, None] * c)
    if SCHEME.sqrt:
        of_output = of_output * _root_slope(u)
    product = tl.sum(own * of_output, 1)
    slope = factor * factor * product if SCHEME.L1 else _slope(total, factor, product, SCHEME.epsilon_outside_root)
    tl.store(out + 4 * at, factor, mask=there)
    tl.store(out + 4 * at + 1, slope, mask=there)
    tl.store(out + 4 * at + 2, again, mask=there)
    tl.store(out + 4 * at + 3, slope_again, mask=there)


@triton.jit
def block_norm_vjp_kernel(
    x,
    grad,
    numbers,
    out,
    count,
    area,
    rows,
    cols,
    grid_rows,
    grid_cols,
    stride,
    SCHEME: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """Gradients of histograms: each cell gathers from the blocks that it is in."""
    image, place, there = places(count, area, TILE)
    row, col = place // cols, place % cols
    k = tl.arange(0, BINS)[None, :]
    bins = there[:, None] & (k < SCHEME.bins)
    own = tl.load(x + (image * stride + place * SCHEME.bins)[:, None] + k, mask=bins, other=0)
    total = tl.zeros_like(own)
    for a in range(SCHEME.high):
        for b in range(SCHEME.wide):
            y, z = (row - a) // SCHEME.down, (col - b) // SCHEME.across
            inside = there & (row >= a) & (col >= b) & (y < grid_rows) & (z < grid_cols)
            inside = inside & ((row - a) % SCHEME.down == 0) & ((col - b) % SCHEME.across == 0)
            block = (image * grid_rows + y) * grid_cols + z
            factor = tl.load(numbers + 4 * block, mask=inside, other=0)[:, None]
            slope = tl.load(numbers + 4 * block + 1, mask=inside, other=0)[:, None]
            channel = block[:, None] * SCHEME.size + (a * SCHEME.wide + b) * SCHEME.bins + k
            of_block = tl.load(grad + channel, mask=inside[:, None] & bins, other=0)
            u = own * factor
            if SCHEME.hys:
                again = tl.load(numbers + 4 * block + 2, mask=inside, other=0)[:, None]
                slope_again = tl.load(numbers + 4 * block + 3, mask=inside, other=0)[:, None]
                of_block = _passes(u, SCHEME) * (again * of_block - slope_again * _clipped(u, SCHEME))
            if SCHEME.sqrt:
                of_block = of_block * _root_slope(u)
            if SCHEME.L1:
                total += factor * of_block - slope
            else:
                total += factor * of_block - slope * own
    tl.store(out + (image * area + place)[:, None] * SCHEME.bins + k, total, mask=bins)
