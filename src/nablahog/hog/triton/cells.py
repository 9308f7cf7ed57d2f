"""Eq. 1-6 in Triton: images to cells, and the tangents of cells.

Each program owns a row of cells, or a part of it, and gathers the votes of the pixels around: no other program writes
there, and sums are always in the same order.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import gradient_tangents, gradients, quotient
from .votes import bin_after, bin_before, magnitude


@triton.jit
def program_place(chunks_y, chunks_x):
    """The image of this program, and its place in it."""
    program = tl.program_id(0)
    chunk = program // chunks_x
    return (chunk // chunks_y).to(tl.int64), chunk % chunks_y, program % chunks_x


@triton.jit
def of_image(pixels, image, stride, strides, COLOURS: tl.constexpr):
    """Where an image, or one of its colours that are described separately, begins."""
    at = image // COLOURS * stride
    if COLOURS > 1:
        at += image % COLOURS * strides[0]
    return pixels + at


@triton.jit
def _not_finite(pixels, size, strides, chunk, chunks, TILE_Y: tl.constexpr, TILE_X: tl.constexpr, channels):
    """1 if there is NaN or infinity in this program's share of the image: pixels that do not vote count, too."""
    high, wide = (size[0] + chunks[0] - 1) // chunks[0], (size[1] + chunks[1] - 1) // chunks[1]
    first_y, first_x = chunk[0] * high, chunk[1] * wide
    last_y, last_x = tl.minimum(first_y + high, size[0]), tl.minimum(first_x + wide, size[1])
    spoilt = tl.zeros([TILE_Y, TILE_X], tl.int32)
    for top in range(first_y, last_y, TILE_Y):
        y = top + tl.arange(0, TILE_Y)[:, None]
        for left in range(first_x, last_x, TILE_X):
            x = left + tl.arange(0, TILE_X)[None, :]
            at = pixels + (y.to(tl.int64) * strides[1] + x.to(tl.int64) * strides[2])
            for _ in range(channels):
                value = tl.load(at, mask=(y < last_y) & (x < last_x), other=0)
                spoilt |= (value - value != 0).to(tl.int32)
                at += strides[0]
    return tl.max(tl.max(spoilt, 1), 0)


@triton.jit
def _column_weights(weights, first, j, x, cells, length):
    """(cells, pixels): the weights of columns of pixels in columns of cells."""
    inside = j < cells
    place = x - tl.load(first + j, mask=inside, other=0)
    return tl.load(weights + j * length + place, mask=inside & (place >= 0) & (place < length), other=0)


@triton.jit
def cells_kernel(
    images,
    tangents,
    out,
    flags,
    table,
    row_spans,
    row_first,
    row_weights,
    col_spans,
    col_first,
    col_weights,
    size,
    stride,
    strides,
    other_stride,
    other,
    grid,
    chunks,
    lengths,
    of_chunk,
    last_wins,
    channels,
    out_stride,
    flag_stride,
    VOTES: tl.constexpr,
    READING: tl.constexpr,
    VOTING: tl.constexpr,
    COLOURS: tl.constexpr,
    TANGENTS: tl.constexpr,
    CHECKED: tl.constexpr,
    ONCE: tl.constexpr,
    TILE_Y: tl.constexpr,
    TILE_X: tl.constexpr,
    CELLS: tl.constexpr,
):
    """Cells (images, rows, cols, bins), ``out_stride`` from image to image, of images, or their tangents.

    Sets ``flags`` of images with a pixel that is not finite.
    """
    REAL: tl.constexpr = out.dtype.element_ty
    image, row, part = program_place(chunks[0], chunks[1])
    pixels = of_image(images, image, stride, strides, COLOURS)
    if CHECKED:
        all_channels = of_image(images, image, stride, (strides[0] * 0, strides[1], strides[2]), COLOURS)
        spoilt = _not_finite(all_channels, size, strides, (row, part), chunks, TILE_Y, TILE_X, channels)
        tl.store(flags + image * flag_stride, tl.full([], 1, flags.dtype.element_ty), mask=spoilt > 0)
    j = part * of_chunk + tl.arange(0, CELLS)
    here = (j < grid[1]) & (j < (part + 1) * of_chunk)
    to = out + image * out_stride + (row * grid[1] + j) * VOTING.bins
    top, bottom = tl.load(row_spans + 2 * row), tl.load(row_spans + 2 * row + 1)
    start, stop = tl.load(col_spans + 2 * part), tl.load(col_spans + 2 * part + 1)
    first_row = tl.load(row_first + row)
    if not ONCE:
        for k in range(VOTING.bins):
            tl.store(to + k, tl.zeros([CELLS], REAL), mask=here)
        tl.debug_barrier()  # each tile reads what was written before
    for tile_y in range(top, tl.maximum(bottom, top + 1), TILE_Y):
        y = tile_y + tl.arange(0, TILE_Y)[:, None]
        place = y - first_row
        voting_row = (place >= 0) & (place < lengths[0]) & (y < size[0])
        by_row = tl.load(row_weights + row * lengths[0] + place, mask=voting_row, other=0)
        for tile_x in range(start, tl.maximum(stop, start + 1), TILE_X):
            x = tile_x + tl.arange(0, TILE_X)[None, :]
            inside = voting_row & (x < stop)
            gx, gy, winner = gradients(pixels, y, x, inside, size, strides, last_wins, READING, REAL)
            m = tl.where(inside, magnitude(gx, gy), 0.0)
            own, next_, f, near, r = VOTES(gx, gy, table, VOTING)
            by_col = _column_weights(col_weights, col_first, j[:, None], x, grid[1], lengths[1])
            if TANGENTS:
                changes = of_image(tangents, image, other_stride, other, COLOURS)
                dx, dy = gradient_tangents(pixels, changes, y, x, inside, size, strides, other, winner, READING, REAL)
                some = m > 0
                inverse = tl.where(some, quotient(tl.where(some, 1.0, 0.0).to(REAL), tl.where(some, m, 1.0)), 0.0)
                along = (gx * dx + gy * dy) * inverse  # of the magnitude
                across = VOTING.slope * (gx * dy - gy * dx) * inverse  # of the position in bins, times the magnitude
                to_near = tl.where(r > 0, -across, tl.where(r < 0, across, 0.0))
                to_after = tl.where(r > 0, across, tl.where(r < 0, 0.0, across * 0.5))
                to_before = -to_near - to_after
                after, before = bin_after(near, VOTING), bin_before(near, VOTING)
                m = along
            to_next = f * m * by_row
            to_own = (1 - f) * m * by_row
            for k in range(VOTING.bins):
                vote = tl.where(own == k, to_own, 0.0)
                if not VOTING.hard:
                    vote = tl.where(next_ == k, to_next, vote)
                    if TANGENTS:
                        vote += tl.where(near == k, to_near * by_row, 0.0)
                        vote += tl.where(after == k, to_after * by_row, 0.0)
                        vote += tl.where(before == k, to_before * by_row, 0.0)
                votes = tl.sum(vote, 0)
                pooled = tl.sum(by_col * votes[None, :], 1)
                if not ONCE:
                    pooled += tl.load(to + k, mask=here, other=0)
                tl.store(to + k, pooled, mask=here)
            if not ONCE:
                tl.debug_barrier()
