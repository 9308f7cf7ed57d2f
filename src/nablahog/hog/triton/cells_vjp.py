"""The vjp of Eq. 1-6 in Triton: each program owns a tile of pixels, and gathers from the cells that they vote into.

Votes are computed again; the tile has a rim of one pixel, so that gradients of neighbours are at hand.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import around, gradients, pixels_vjp, places, values_vjp
from .votes import bin_after, bin_before, magnitude


@triton.jit
def _vote_gradient(
    grad, cell, bins, by_row, by_col, grid, mask, HIGH: tl.constexpr, WIDE: tl.constexpr, COUNT: tl.constexpr
):
    """The vjp of the pooling: gradients of the votes of pixels for ``bins``, from the cells from ``cell`` on."""
    at = grad + (cell * COUNT + bins)
    total = tl.zeros_like(cell).to(grad.dtype.element_ty)
    for a in tl.static_range(HIGH):
        line = tl.zeros_like(total)
        for b in tl.static_range(WIDE):
            cell_gradient = tl.load(at + b * COUNT) if mask is None else tl.load(at + b * COUNT, mask=mask, other=0)
            line = tl.fma(by_col[b], cell_gradient, line)
        total = tl.fma(by_row[a], line, total)
        at += grid[1] * COUNT
    return total


@triton.jit
def cells_vjp_kernel(
    images,
    grad_cells,
    flags,
    out,
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
    VOTES: tl.constexpr,
    READING: tl.constexpr,
    VOTING: tl.constexpr,
    HIGH: tl.constexpr,
    WIDE: tl.constexpr,
    TILE_Y: tl.constexpr,
    TILE_X: tl.constexpr,
):
    """Gradients of images (images, channels, height, width) from those of cells."""
    REAL: tl.constexpr = grad_cells.dtype.element_ty
    stored: tl.constexpr = READING.stored
    described: tl.constexpr = READING.channels
    bins: tl.constexpr = VOTING.bins
    chunk = tl.program_id(0) // chunks[1]
    row, part = chunk % chunks[0], tl.program_id(0) % chunks[1]
    image = (chunk // chunks[0]).to(tl.int64)
    pixels = images + image * stride
    is_nan = tl.load(flags + image) != 0
    y = row * (TILE_Y - 2) - 1 + tl.arange(0, TILE_Y)[:, None]
    x = part * (TILE_X - 2) - 1 + tl.arange(0, TILE_X)[None, :]
    inside = (y >= 0) & (y < size[0]) & (x >= 0) & (x < size[1])
    gx, gy, winner = gradients(around(pixels, y, x, size, strides, READING, REAL), y, x, size, last_wins, READING, REAL)
    m, inverse = magnitude(gx, gy)
    low, f, from_bin, part_of_bin = VOTES(gx, gy, inverse, VOTING)
    low = tl.minimum(tl.maximum(low, 0), bins - 1)  # of NaN it is any number
    has_direction = inside & (m > 0)
    grad = grad_cells + image * grid[0] * grid[1] * bins
    inner_y, inner_x = tl.minimum(tl.maximum(y, 0), size[0] - 1), tl.minimum(tl.maximum(x, 0), size[1] - 1)
    cell = tl.load(first_row + inner_y) * grid[1] + tl.load(first_col + inner_x)
    rows, cols = (), ()
    for a in tl.static_range(HIGH):
        rows = rows + (tl.load(by_row + inner_y * HIGH + a),)
    for b in tl.static_range(WIDE):
        cols = cols + (tl.load(by_col + inner_x * WIDE + b),)
    grad_low = _vote_gradient(grad, cell, low, rows, cols, grid, None, HIGH, WIDE, bins)
    along = grad_low
    across = tl.zeros_like(m)
    if not VOTING.hard:
        grad_high = _vote_gradient(grad, cell, bin_after(low, VOTING), rows, cols, grid, None, HIGH, WIDE, bins)
        along = grad_low + f * (grad_high - grad_low)
        if VOTING.inexact:
            low = tl.minimum(tl.maximum(from_bin, 0), bins - 1)
            grad_low = _vote_gradient(grad, cell, low, rows, cols, grid, None, HIGH, WIDE, bins)
            grad_high = _vote_gradient(grad, cell, bin_after(low, VOTING), rows, cols, grid, None, HIGH, WIDE, bins)
        # at a bin's centre the mean of both sides
        centre = has_direction & (part_of_bin == 0)
        grad_before = _vote_gradient(grad, cell, bin_before(low, VOTING), rows, cols, grid, centre, HIGH, WIDE, bins)
        change = tl.where(centre, (grad_high - grad_before) * 0.5, grad_high - grad_low)
        across = VOTING.slope * change * inverse
    along = along * inverse
    grad_x, grad_y = along * gx - across * gy, along * gy + across * gx
    grad_x, grad_y = tl.where(has_direction, grad_x, 0.0), tl.where(has_direction, grad_y, 0.0)
    rim = (y == row * (TILE_Y - 2) - 1) | (y >= (row + 1) * (TILE_Y - 2))
    rim = rim | (x == part * (TILE_X - 2) - 1) | (x >= (part + 1) * (TILE_X - 2))
    written = inside & (rim == 0)
    at = places(pixels, inner_y, inner_x, strides, READING)
    to_place = y.to(tl.int64) * size[1] + x if READING.wide else y * size[1] + x
    area = (image * 0 + size[0]) * size[1]  # 64 bits
    to = out + image * READING.stored * area
    if READING.averaged:
        grad_values = values_vjp(grad_x, grad_y, y, x, size, READING, REAL)
        for k in tl.static_range(stored):
            grad_pixels = pixels_vjp(grad_values, at, strides, k, READING, REAL)
            tl.store(to + k * area + to_place, tl.where(is_nan, float("nan"), grad_pixels), mask=written)
    else:
        for k in tl.static_range(described):
            own_x, own_y = tl.where(winner == k, grad_x, 0.0), tl.where(winner == k, grad_y, 0.0)
            grad_values = values_vjp(own_x, own_y, y, x, size, READING, REAL)
            grad_pixels = pixels_vjp(grad_values, at, strides, k, READING, REAL)
            tl.store(to + k * area + to_place, tl.where(is_nan, float("nan"), grad_pixels), mask=written)
