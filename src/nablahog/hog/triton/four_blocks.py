"""The UoCTTI normaliser in Triton: each cell by the four blocks it lies in.

A *corner* is where four cells meet, the middle of a block: there are (rows + 1) · (cols + 1).  Block 0, 1, 2, 3 of a
cell is the one at its up-left, up-right, down-left, down-right corner.
"""

from __future__ import annotations

from typing import NamedTuple

import triton
import triton.language as tl

from .gradients import quotient, root
from .norms import places


class FourBlocks(NamedTuple):
    """What the kernels know of a ``FourBlockNorm``."""

    epsilon: float
    clip: float
    floor: bool
    missing: bool  # whether blocks beyond the grid add nothing
    dropped: int  # cells at either end that have no descriptor
    signed: bool
    bins: int
    undirected: int
    channels: int
    directed_at: int  # the first channel of each part, -1 if it is left out
    undirected_at: int
    texture_at: int
    blocks_at: int
    zero_at: int
    directed_texture: bool
    texture: float
    order: tuple[int, ...]  # of blocks: their texture channels


@triton.jit
def _cells(x, image, place, there, stride, SCHEME: tl.constexpr, BINS: tl.constexpr):
    """Histograms of cells: bins of the first half turn, of the second, and both together, (n, undirected) each."""
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < SCHEME.undirected)
    at = x + (image * stride + place * SCHEME.bins)[:, None] + k
    first = tl.load(at, mask=some, other=0)
    second = tl.zeros_like(first)
    if SCHEME.signed:
        second = tl.load(at + SCHEME.undirected, mask=some, other=0)
    return first, second, first + second


@triton.jit
def _energy(x, y, image, place, there, stride, other_stride, SCHEME: tl.constexpr, BINS: tl.constexpr):
    """⟨u, w⟩ of the undirected histograms u of ``x`` and w of ``y``."""
    _, _, u = _cells(x, image, place, there, stride, SCHEME, BINS)
    _, _, w = _cells(y, image, place, there, other_stride, SCHEME, BINS)
    return tl.sum(u * w, 1)


@triton.jit
def _corner_energy(
    x, y, image, row, col, there, rows, cols, stride, other_stride, SCHEME: tl.constexpr, BINS: tl.constexpr
):
    """The same summed over the cells around a corner; cells beyond the grid repeat its edge."""
    above, below = tl.maximum(row - 1, 0) * cols, tl.minimum(row, rows - 1) * cols
    left, right = tl.maximum(col - 1, 0), tl.minimum(col, cols - 1)
    total = _energy(x, y, image, above + left, there, stride, other_stride, SCHEME, BINS)
    total += _energy(x, y, image, above + right, there, stride, other_stride, SCHEME, BINS)
    lower = _energy(x, y, image, below + left, there, stride, other_stride, SCHEME, BINS)
    lower += _energy(x, y, image, below + right, there, stride, other_stride, SCHEME, BINS)
    return total + lower


@triton.jit
def _factor(energy, counted, SCHEME: tl.constexpr):
    """What a block multiplies with, and the derivative of that with respect to its energy; 0 if not ``counted``."""
    if SCHEME.floor:
        norm = root(energy)
        length = tl.where(norm <= SCHEME.epsilon, SCHEME.epsilon, norm)
        factor = quotient(tl.full([1], 1, energy.dtype), length)
        moves = tl.where(norm > SCHEME.epsilon, 1.0, tl.where(norm == SCHEME.epsilon, 0.5, 0.0))
        slope = -0.5 * moves * factor * factor * factor
    else:
        factor = quotient(tl.full([1], 1, energy.dtype), root(energy + SCHEME.epsilon))
        slope = -0.5 * factor * factor * factor
    return tl.where(counted, factor, 0.0), tl.where(counted, slope, 0.0)


@triton.jit
def _counted(row, col, rows, cols, SCHEME: tl.constexpr):
    """Whether the block at a corner counts."""
    counted = row >= 0
    if SCHEME.missing:
        counted = (row > 0) & (row < rows) & (col > 0) & (col < cols)
    return counted


@triton.jit
def _passes(u, SCHEME: tl.constexpr):
    """The derivative of the clip; where equal, the mean of both sides."""
    return tl.where(u < SCHEME.clip, 1.0, tl.where(u == SCHEME.clip, 0.5, 0.0)).to(u.dtype)


@triton.jit
def _grad_entries(
    grad, at, first, second, both, factor, block: tl.constexpr, there, SCHEME: tl.constexpr, BINS: tl.constexpr
):
    """Gradients of the entries of one block before they are clipped: of either half turn, and of both together."""
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < SCHEME.undirected)
    to = grad + (at * SCHEME.channels)[:, None]
    of_first, of_second, of_both = tl.zeros_like(first), tl.zeros_like(first), tl.zeros_like(first)
    if SCHEME.directed_at >= 0:
        of_first += 0.5 * tl.load(to + SCHEME.directed_at + k, mask=some, other=0)
        of_second += 0.5 * tl.load(to + SCHEME.directed_at + SCHEME.undirected + k, mask=some, other=0)
    if SCHEME.undirected_at >= 0:
        of_both += 0.5 * tl.load(to + SCHEME.undirected_at + k, mask=some, other=0)
    if SCHEME.texture_at >= 0:
        channel = grad + at * SCHEME.channels + SCHEME.texture_at + SCHEME.order[block]
        texture = SCHEME.texture * tl.load(channel, mask=there, other=0)[:, None]
        if SCHEME.directed_texture:
            of_first, of_second = of_first + texture, of_second + texture
        else:
            of_both += texture
    if SCHEME.blocks_at >= 0:
        of_both += tl.load(to + SCHEME.blocks_at + block * SCHEME.undirected + k, mask=some, other=0)
    f = factor[:, None]
    return (
        of_first * _passes(first * f, SCHEME),
        of_second * _passes(second * f, SCHEME),
        of_both * _passes(both * f, SCHEME),
    )


@triton.jit
def corners_kernel(
    x,
    tangents,
    factors,
    changes,
    count,
    rows,
    cols,
    stride,
    other_stride,
    SCHEME: tl.constexpr,
    TANGENTS: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """The factors (images, rows + 1, cols + 1) of all blocks, and their tangents."""
    image, place, there = places(count, (rows + 1) * (cols + 1), TILE)
    row, col = place // (cols + 1), place % (cols + 1)
    counted = _counted(row, col, rows, cols, SCHEME)
    energy = _corner_energy(x, x, image, row, col, there, rows, cols, stride, stride, SCHEME, BINS)
    factor, slope = _factor(energy, counted, SCHEME)
    at = image * ((rows + 1) * (cols + 1)) + place
    tl.store(factors + at, factor, mask=there)
    if TANGENTS:
        product = _corner_energy(x, tangents, image, row, col, there, rows, cols, stride, other_stride, SCHEME, BINS)
        tl.store(changes + at, 2 * slope * product, mask=there)


@triton.jit
def corners_vjp_kernel(
    x,
    grad,
    factors,
    out,
    count,
    rows,
    cols,
    stride,
    SCHEME: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """Gradients of the energies of all blocks, from those of the descriptors."""
    image, place, there = places(count, (rows + 1) * (cols + 1), TILE)
    row, col = place // (cols + 1), place % (cols + 1)
    energy = _corner_energy(x, x, image, row, col, there, rows, cols, stride, stride, SCHEME, BINS)
    _, slope = _factor(energy, _counted(row, col, rows, cols, SCHEME), SCHEME)
    at = image * ((rows + 1) * (cols + 1)) + place
    factor = tl.load(factors + at, mask=there, other=0)
    margin: tl.constexpr = SCHEME.dropped
    total = tl.zeros_like(factor)
    for block in tl.static_range(4):  # this corner is that one of the cell
        y, z = row - block // 2, col - block % 2
        inside = there & (y >= margin) & (y < rows - margin) & (z >= margin) & (z < cols - margin)
        cell = tl.where(inside, y * cols + z, 0)
        first, second, both = _cells(x, image, cell, inside, stride, SCHEME, BINS)
        of_cell = (image * (rows - 2 * margin) + y - margin) * (cols - 2 * margin) + z - margin
        of_first, of_second, of_both = _grad_entries(
            grad, of_cell, first, second, both, factor, block, inside, SCHEME, BINS
        )
        total += tl.sum(of_first * first + of_second * second + of_both * both, 1)
    tl.store(out + at, slope * total, mask=there)


@triton.jit
def four_block_norm_kernel(
    x,
    tangents,
    factors,
    changes,
    flags,
    out,
    count,
    rows,
    cols,
    stride,
    other_stride,
    flag_stride,
    SCHEME: tl.constexpr,
    TANGENTS: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """Descriptors of cells (images, rows, cols, channels), or their tangents."""
    margin: tl.constexpr = SCHEME.dropped
    grid_cols = cols - 2 * margin
    area = (rows - 2 * margin) * grid_cols
    image, place, there = places(count, area, TILE)
    row, col = place // grid_cols + margin, place % grid_cols + margin
    first, second, both = _cells(x, image, row * cols + col, there, stride, SCHEME, BINS)
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < SCHEME.undirected)
    spoilt = tl.load(flags + image * flag_stride, mask=there, other=0) != 0
    nan_or_zero = tl.where(spoilt, float("nan"), 0.0).to(first.dtype)
    spoil = nan_or_zero[:, None]
    to = out + ((image * area + place) * SCHEME.channels)[:, None]
    of_cell = out + (image * area + place) * SCHEME.channels
    if TANGENTS:
        moved, moved_too, moved_both = _cells(tangents, image, row * cols + col, there, other_stride, SCHEME, BINS)
    sum_first, sum_second, sum_both = tl.zeros_like(first), tl.zeros_like(first), tl.zeros_like(first)
    for block in tl.static_range(4):
        corner = (image * (rows + 1) + row + block // 2) * (cols + 1) + col + block % 2
        f = tl.load(factors + corner, mask=there, other=0)[:, None]
        one, two, all_ = first * f, second * f, both * f
        if TANGENTS:
            df = tl.load(changes + corner, mask=there, other=0)[:, None]
            one = _passes(one, SCHEME) * (moved * f + first * df)
            two = _passes(two, SCHEME) * (moved_too * f + second * df)
            all_ = _passes(all_, SCHEME) * (moved_both * f + both * df)
        else:
            one = tl.where(one > SCHEME.clip, SCHEME.clip, one)  # NaN stays
            two = tl.where(two > SCHEME.clip, SCHEME.clip, two)
            all_ = tl.where(all_ > SCHEME.clip, SCHEME.clip, all_)
        sum_first, sum_second, sum_both = sum_first + one, sum_second + two, sum_both + all_
        if SCHEME.texture_at >= 0:
            texture = SCHEME.texture * tl.sum(one + two if SCHEME.directed_texture else all_, 1)
            tl.store(of_cell + SCHEME.texture_at + SCHEME.order[block], texture + nan_or_zero, mask=there)
        if SCHEME.blocks_at >= 0:
            tl.store(to + SCHEME.blocks_at + block * SCHEME.undirected + k, all_ + spoil, mask=some)
    if SCHEME.directed_at >= 0:
        tl.store(to + SCHEME.directed_at + k, sum_first * 0.5 + spoil, mask=some)
        tl.store(to + SCHEME.directed_at + SCHEME.undirected + k, sum_second * 0.5 + spoil, mask=some)
    if SCHEME.undirected_at >= 0:
        tl.store(to + SCHEME.undirected_at + k, sum_both * 0.5 + spoil, mask=some)
    if SCHEME.zero_at >= 0:
        tl.store(of_cell + SCHEME.zero_at, nan_or_zero, mask=there)


@triton.jit
def four_block_norm_vjp_kernel(
    x,
    grad,
    factors,
    slopes,
    out,
    count,
    rows,
    cols,
    stride,
    SCHEME: tl.constexpr,
    TILE: tl.constexpr,
    BINS: tl.constexpr,
):
    """Gradients of histograms, from those of the descriptors and of the energies of all blocks."""
    margin: tl.constexpr = SCHEME.dropped
    image, place, there = places(count, rows * cols, TILE)
    row, col = place // cols, place % cols
    first, second, both = _cells(x, image, place, there, stride, SCHEME, BINS)
    described = there & (row >= margin) & (row < rows - margin) & (col >= margin) & (col < cols - margin)
    of_cell = (image * (rows - 2 * margin) + row - margin) * (cols - 2 * margin) + col - margin
    to_first, to_second, to_both = tl.zeros_like(first), tl.zeros_like(first), tl.zeros_like(first)
    for block in tl.static_range(4):
        corner = (image * (rows + 1) + row + block // 2) * (cols + 1) + col + block % 2
        factor = tl.load(factors + corner, mask=there, other=0)
        of_first, of_second, of_both = _grad_entries(
            grad, of_cell, first, second, both, factor, block, described, SCHEME, BINS
        )
        f = factor[:, None]
        to_first, to_second, to_both = to_first + of_first * f, to_second + of_second * f, to_both + of_both * f
        # a cell at the edge is also the one beyond it
        twice_row = (row == 0) if block < 2 else (row == rows - 1)
        twice_col = (col == 0) if block % 2 == 0 else (col == cols - 1)
        times = tl.where(twice_row, 2, 1) * tl.where(twice_col, 2, 1)
        slope = tl.load(slopes + corner, mask=there, other=0) * times
        to_both += 2 * both * slope[:, None]
    k = tl.arange(0, BINS)[None, :]
    some = there[:, None] & (k < SCHEME.undirected)
    to = out + ((image * (rows * cols) + place) * SCHEME.bins)[:, None] + k
    tl.store(to, to_first + to_both, mask=some)
    if SCHEME.signed:
        tl.store(to + SCHEME.undirected, to_second + to_both, mask=some)
