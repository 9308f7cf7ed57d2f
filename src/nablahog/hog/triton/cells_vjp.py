"""The vjp of Eq. 1-6 in Triton: each program owns a tile of pixels, and gathers from the cells that they vote into.

Votes are computed again; the tile has a rim of one pixel, so that gradients of neighbours are at hand.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .cells import of_image, program_place
from .gradients import gradients, pixels_vjp, quotient, values_vjp
from .votes import bin_after, bin_before, magnitude


@triton.jit
def _of_bins(
    grad,
    bins,
    by_row,
    by_col,
    row,
    col,
    y,
    x,
    inside,
    grid,
    HIGH: tl.constexpr,
    WIDE: tl.constexpr,
    COUNT: tl.constexpr,
):
    """The vjp of the pooling: gradients of the votes of pixels for ``bins``."""
    total = tl.zeros_like(bins).to(grad.dtype.element_ty)
    for a in tl.static_range(HIGH):
        of_row = tl.load(by_row + y * HIGH + a, mask=inside, other=0)
        line = tl.zeros_like(total)
        for b in tl.static_range(WIDE):
            of_col = tl.load(by_col + x * WIDE + b, mask=inside, other=0)
            cell = (row + a) * grid[1] + col + b
            there = inside & (row + a < grid[0]) & (col + b < grid[1])
            line += of_col * tl.load(grad + cell * COUNT + bins, mask=there, other=0)
        total += of_row * line
    return total


@triton.jit
def cells_vjp_kernel(
    images,
    grad_cells,
    flags,
    out,
    table,
    first_row,
    by_row,
    first_col,
    by_col,
    size,
    stride,
    strides,
    grid,
    chunks,
    last_wins,
    flag_stride,
    VOTES: tl.constexpr,
    READING: tl.constexpr,
    VOTING: tl.constexpr,
    COLOURS: tl.constexpr,
    HIGH: tl.constexpr,
    WIDE: tl.constexpr,
    TILE_Y: tl.constexpr,
    TILE_X: tl.constexpr,
):
    """Gradients of images (images, channels, height, width), or of each colour alone, from those of cells."""
    REAL: tl.constexpr = grad_cells.dtype.element_ty
    stored: tl.constexpr = READING.stored
    described: tl.constexpr = READING.channels
    image, row, part = program_place(chunks[0], chunks[1])
    pixels = of_image(images, image, stride, strides, COLOURS)
    spoilt = tl.load(flags + image * flag_stride) != 0
    y = row * (TILE_Y - 2) - 1 + tl.arange(0, TILE_Y)[:, None]
    x = part * (TILE_X - 2) - 1 + tl.arange(0, TILE_X)[None, :]
    inside = (y >= 0) & (y < size[0]) & (x >= 0) & (x < size[1])
    gx, gy, winner = gradients(pixels, y, x, inside, size, strides, last_wins, READING, REAL)
    m = tl.where(inside, magnitude(gx, gy), 0.0)
    own, other, f, near, r = VOTES(gx, gy, table, VOTING)
    some = m > 0
    inverse = tl.where(some, quotient(tl.where(some, 1.0, 0.0).to(REAL), tl.where(some, m, 1.0)), 0.0)
    grad = grad_cells + image * grid[0] * grid[1] * VOTING.bins
    cell_row, cell_col = tl.load(first_row + y, mask=inside, other=0), tl.load(first_col + x, mask=inside, other=0)
    of_own = _of_bins(grad, own, by_row, by_col, cell_row, cell_col, y, x, some, grid, HIGH, WIDE, VOTING.bins)
    along = of_own
    across = tl.zeros_like(m)
    if not VOTING.hard:
        of_other = _of_bins(grad, other, by_row, by_col, cell_row, cell_col, y, x, some, grid, HIGH, WIDE, VOTING.bins)
        along = of_own + f * (of_other - of_own)
        after, before = bin_after(near, VOTING), bin_before(near, VOTING)
        of_near = of_own
        if VOTING.inexact:
            of_near = _of_bins(
                grad, near, by_row, by_col, cell_row, cell_col, y, x, some, grid, HIGH, WIDE, VOTING.bins
            )
        of_after = _of_bins(grad, after, by_row, by_col, cell_row, cell_col, y, x, some, grid, HIGH, WIDE, VOTING.bins)
        of_before = _of_bins(
            grad, before, by_row, by_col, cell_row, cell_col, y, x, some, grid, HIGH, WIDE, VOTING.bins
        )
        # at a bin's centre the mean of both sides
        middle = (of_after - of_before) * 0.5
        change = tl.where(r > 0, of_after - of_near, tl.where(r < 0, of_near - of_before, middle))
        across = tl.where(some, VOTING.slope * change * inverse, 0.0)
    along = tl.where(some, along * inverse, 0.0)
    grad_x, grad_y = along * gx - across * gy, along * gy + across * gx
    grad_x, grad_y = tl.where(some, grad_x, 0.0), tl.where(some, grad_y, 0.0)
    rim = (y == row * (TILE_Y - 2) - 1) | (y >= (row + 1) * (TILE_Y - 2))
    rim = rim | (x == part * (TILE_X - 2) - 1) | (x >= (part + 1) * (TILE_X - 2))
    written = inside & (rim == 0)
    at = y.to(tl.int64) * size[1] + x if READING.wide else y * size[1] + x
    area = (image * 0 + size[0]) * size[1]  # 64 bits
    to = out + image * READING.stored * area
    if READING.averaged:
        of_values = values_vjp(grad_x, grad_y, y, x, size, READING, REAL)
        for k in tl.static_range(stored):
            value = pixels_vjp(of_values, pixels, y, x, inside, strides, k, READING, REAL)
            tl.store(to + k * area + at, tl.where(spoilt, float("nan"), value), mask=written)
    else:
        for k in tl.static_range(described):
            of_x, of_y = tl.where(winner == k, grad_x, 0.0), tl.where(winner == k, grad_y, 0.0)
            of_values = values_vjp(of_x, of_y, y, x, size, READING, REAL)
            value = pixels_vjp(of_values, pixels, y, x, inside, strides, k, READING, REAL)
            tl.store(to + k * area + at, tl.where(spoilt, float("nan"), value), mask=written)
