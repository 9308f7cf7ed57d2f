"""Eq. 1-6 in Triton: images to cells.

Along either axis pixels lie in bands: runs that vote into the same cells (:class:`.parameters.Bands`).  A lane, one
thread of a warp, owns one band of columns and goes down some rows of cells.  It adds the votes of its pixels to
histograms in its registers, one for each cell that the band votes into; at the end of a band of rows, those of
neighbouring lanes are summed.  No other program writes the same cells, and sums are always in the same order.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import gradients, neighbour, places, value
from .votes import EVEN_32, EVEN_64, magnitude, votes_of_even_and_odd

LANES = 32
"""Of a program: a warp, so that lanes exchange sums without waiting for other warps."""
_LANES = tl.constexpr(LANES)


@triton.jit
def _place(pixels, y, columns, d: tl.constexpr, strides, READING: tl.constexpr, CLAMPED: tl.constexpr):
    """Where the pixels of one of the columns are in memory."""
    last: tl.constexpr = len(columns) - 1
    if d == 0 or d == last or CLAMPED or READING.wide:
        at = places(pixels, y, columns[d], strides, READING)
    else:  # at a fixed distance from the first of the lane's own, which takes no arithmetic
        at = places(pixels, y, columns[1], strides, READING) + (d - 1) * strides[2]
    return at


@triton.jit
def _row(pixels, y, columns, size, strides, READING: tl.constexpr, REAL: tl.constexpr, CLAMPED: tl.constexpr):
    """Values of one row of each lane, by channel: from the column before to the one behind."""
    described: tl.constexpr = READING.channels
    count: tl.constexpr = len(columns)
    y = neighbour(y, size[0], READING)
    row = ()
    for k in tl.static_range(described):
        values = ()
        for d in tl.static_range(count):
            at = _place(pixels, y, columns, d, strides, READING, CLAMPED)
            values = values + (value(at, strides, k, READING, REAL),)
        row = row + (values,)
    return row


@triton.jit
def _around(above, row, below, d: tl.constexpr, READING: tl.constexpr):
    """The neighbours, in three rows, of the lanes' pixels of one column."""
    described: tl.constexpr = READING.channels
    arounds = ()
    for k in tl.static_range(described):
        arounds = arounds + (above[k][d : d + 3] + row[k][d : d + 3] + below[k][d : d + 3],)
    return arounds


@triton.jit
def _spread_nan(row, zero_or_nan, READING: tl.constexpr):
    """NaN once a value, but for the outermost two columns, is not finite."""
    count: tl.constexpr = len(row[0])
    described: tl.constexpr = READING.channels
    for k in tl.static_range(described):
        for d in tl.static_range(1, count - 1):
            zero_or_nan = tl.fma(row[k][d], 0.0, zero_or_nan)
    return zero_or_nan


@triton.jit
def _spread_nan_outside(pixels, size, strides, voting, program, programs, zero_or_nan, channels):
    """NaN if a pixel in the program's share of what is outside of the rectangle ``voting`` is not finite."""
    tops, bottoms = (0, voting[1], voting[0], voting[0]), (voting[0], size[0], voting[1], voting[1])
    lefts, rights = (0, 0, 0, voting[3]), (size[1], size[1], voting[2], size[1])
    for side in tl.static_range(4):
        wide = rights[side] - lefts[side]
        count = (bottoms[side] - tops[side]).to(tl.int64) * wide
        for first in range(program.to(tl.int64) * _LANES, count, programs * _LANES):
            place = first + tl.arange(0, _LANES)
            y, x = tops[side] + place // tl.maximum(wide, 1), lefts[side] + place % tl.maximum(wide, 1)
            at = pixels + (y * strides[1] + x * strides[2])
            for _ in range(channels):
                zero_or_nan = tl.fma(tl.load(at, mask=place < count, other=0).to(zero_or_nan.dtype), 0.0, zero_or_nan)
                at += strides[0]
    return zero_or_nan


@triton.jit
def _order_by_parity(low, vote_low, vote_after):
    """Votes for a bin and the bin after it, as those for the even and for the odd one of the two.

    So each bin asks for one vote only.  Returns the even bin, its vote, the bin before the odd one, the odd one's vote.
    """
    odd = (low & 1) == 1
    return (low + 1) & -2, tl.where(odd, vote_after, vote_low), low & -2, tl.where(odd, vote_low, vote_after)


@triton.jit
def _votes(gx, gy, VOTES: tl.constexpr, VOTING: tl.constexpr):
    """Bins of pixels and the votes for them; linear votes as :func:`_order_by_parity` returns them."""
    if VOTING.exact:
        votes = votes_of_even_and_odd(gx, gy, VOTING)
    else:
        m, inverse = magnitude(gx, gy)
        low, f, _, _ = VOTES(gx, gy, inverse, VOTING)
        votes = (low, m) if VOTING.hard else _order_by_parity(low, m - f * m, f * m)
    return votes


@triton.jit
def _add_votes(total, votes, number: tl.constexpr, first: tl.constexpr, step: tl.constexpr, weights):
    """Adds the votes of each lane's pixels for the bin of this number, weighted."""
    own = tl.full([], number, votes[0][0].dtype)  # comparisons of Triton 3.8 take numbers for float32
    pixels: tl.constexpr = len(votes)
    kinds: tl.constexpr = len(votes[0])
    for kind in tl.static_range(first, kinds, step):
        for pixel in tl.static_range(pixels):
            added = tl.fma(votes[pixel][kind + 1], weights[pixel], total)
            total = tl.where(votes[pixel][kind] == own, added, total)
    return total


@triton.jit
def _sum_votes(votes, k: tl.constexpr, weights, zero, VOTING: tl.constexpr):
    """The votes of each lane's pixels for bin k, weighted and summed."""
    total = zero
    bins: tl.constexpr = VOTING.bins
    if VOTING.hard:
        total = _add_votes(total, votes, k, 0, 2, weights)
    elif VOTING.exact:
        shift: tl.constexpr = EVEN_64 if zero.dtype == tl.float64 else EVEN_32
        lowest: tl.constexpr = VOTING.lowest
        highest: tl.constexpr = VOTING.highest
        for number in tl.static_range(lowest + (k - lowest) % bins, highest + 1, bins):
            total = _add_votes(total, votes, shift + (number - number % 2), number % 2 * 2, 4, weights)
    else:
        for number in tl.static_range(k, bins + 1, bins):  # bin 0 is the one after the last, too
            total = _add_votes(total, votes, number - number % 2, number % 2 * 2, 4, weights)
    return total


@triton.jit
def cells_kernel(
    images,
    out,
    flags,
    row_first,
    row_weights,
    col_first,
    col_weights,
    size,
    stride,
    strides,
    grid,
    longest,
    chunks,
    chunk_cols,
    strips,
    strip_rows,
    voting,
    last_wins,
    channels,
    VOTES: tl.constexpr,
    READING: tl.constexpr,
    VOTING: tl.constexpr,
    HIGH: tl.constexpr,
    WIDE: tl.constexpr,
    AT_ONCE: tl.constexpr,
    CLAMPED: tl.constexpr,
    CHECKED: tl.constexpr,
):
    """Cells (images, rows, cols, bins) of images.

    A program has ``strips[1]`` strips of ``strip_rows`` rows and ``chunk_cols`` columns of cells.  Bands vote into
    HIGH x WIDE cells; a lane reads AT_ONCE of its columns at a time; CLAMPED if some are beyond the image.  Sets
    ``flags`` of images with a pixel that is not finite.
    """
    REAL: tl.constexpr = out.dtype.element_ty
    bins: tl.constexpr = VOTING.bins
    chunk, group = tl.program_id(0) % chunks, tl.program_id(0) // chunks
    groups = (strips[0] + strips[1] - 1) // strips[1]
    image, group = (group // groups).to(tl.int64), group % groups
    pixels = images + image * stride
    lane = tl.arange(0, _LANES)
    lanes = chunk_cols + WIDE - 1  # of a strip
    strip = group * strips[1] + lane // lanes
    j = chunk * chunk_cols + lane % lanes
    owned = (lane % lanes < chunk_cols) & (j < grid[1]) & (lane // lanes < strips[1])
    row_bands, col_bands = grid[0] + HIGH - 1, grid[1] + WIDE - 1
    col_band = tl.minimum(j, col_bands - 1)
    first_column = tl.load(col_first + col_band)

    zero = tl.zeros([_LANES], REAL)
    zero_or_nan = zero
    none = ()
    for _ in tl.static_range(WIDE * HIGH):
        none = none + (zero,)
    sums = ()
    for _ in tl.static_range(bins):
        sums = sums + (none,)
    for step in range(strip_rows + HIGH - 1):
        row_band = tl.minimum(strip * strip_rows + step, row_bands - 1)
        first_row = tl.load(row_first + row_band)
        for start in range(0, longest[1], AT_ONCE):
            columns = ()
            for d in tl.static_range(AT_ONCE + 2):
                columns = columns + (neighbour(first_column + start + (d - 1), size[1], READING),)
            by_col = ()
            for e in tl.static_range(WIDE):
                weights = ()
                for d in tl.static_range(AT_ONCE):
                    weights = weights + (tl.load(col_weights + ((start + d) * WIDE + e) * col_bands + col_band),)
                by_col = by_col + (weights,)
            above = _row(pixels, first_row - 1, columns, size, strides, READING, REAL, CLAMPED)
            row = _row(pixels, first_row, columns, size, strides, READING, REAL, CLAMPED)
            below = _row(pixels, first_row + 1, columns, size, strides, READING, REAL, CLAMPED)
            for i in range(longest[0]):
                y = first_row + i
                # needed in the next round only: nothing waits for memory meanwhile
                ahead = _row(pixels, y + 2, columns, size, strides, READING, REAL, CLAMPED)
                if CHECKED:
                    zero_or_nan = _spread_nan(row, zero_or_nan, READING)
                votes = ()
                for d in tl.static_range(AT_ONCE):
                    x = first_column + start + d
                    arounds = _around(above, row, below, d, READING)
                    gx, gy, _winner = gradients(arounds, y, x, size, last_wins, READING, REAL)
                    votes = votes + (_votes(gx, gy, VOTES, VOTING),)
                above, row, below = row, below, ahead
                by_row = ()
                for h in tl.static_range(HIGH):
                    by_row = by_row + (tl.load(row_weights + (i * HIGH + h) * row_bands + row_band),)
                added = ()
                for k in tl.static_range(bins):
                    cell_sums = ()
                    for e in tl.static_range(WIDE):
                        row_sum = _sum_votes(votes, k, by_col[e], zero, VOTING)
                        for h in tl.static_range(HIGH):
                            cell_sums = cell_sums + (tl.fma(row_sum, by_row[h], sums[k][e * HIGH + h]),)
                    added = added + (cell_sums,)
                sums = added
        # the upmost row of cells that this band voted into is complete
        i = strip * strip_rows + step - (HIGH - 1)
        complete = owned & (step >= HIGH - 1) & (i < grid[0])
        to = out + image * (grid[0] * grid[1] * bins) + (i * grid[1] + j) * bins
        moved = ()
        for k in tl.static_range(bins):
            cell_sum = sums[k][(WIDE - 1) * HIGH]
            for e in tl.static_range(1, WIDE):  # of the bands to the right
                cell_sum += tl.gather(sums[k][(WIDE - 1 - e) * HIGH], tl.minimum(lane + e, _LANES - 1), 0)
            tl.store(to + k, cell_sum, mask=complete)
            cell_sums = ()
            for e in tl.static_range(WIDE):
                cell_sums = cell_sums + sums[k][e * HIGH + 1 : e * HIGH + HIGH] + (zero,)
            moved = moved + (cell_sums,)
        sums = moved
    if CHECKED:
        zero_or_nan = _spread_nan_outside(
            pixels, size, strides, voting, group * chunks + chunk, groups * chunks, zero_or_nan, channels
        )
        has_nan = tl.max((zero_or_nan != zero_or_nan).to(tl.int32), 0) > 0
        tl.store(flags + image, tl.full([], 1, flags.dtype.element_ty), mask=has_nan)
