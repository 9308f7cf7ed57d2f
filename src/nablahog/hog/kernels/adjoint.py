"""The adjoint of Eq. 1-6 in one pass: from what reaches the cell histograms to what reaches the images.

Votes are made again, a line at a time.  What reaches the gradients of three lines is kept; a row of the image hears
from the row before it, its own and the one after it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compile import compiled
from ..gradient import BLACK
from .cells import PIXELS_AT_ONCE, empty_groups, gradients_of_rows, place
from .lanes import read_four, read_four_more
from .votes import linear, vote_line


@compiled
def _spread(given: Any, pooling: Any, band: int, groups: Any) -> None:
    """What reaches the cells, ``given`` (rows, columns, bins), to the groups of a band: the adjoint of collecting."""
    bins, size, first = pooling.bins, pooling.group, pooling.bands[band, 2]
    cells = given.reshape(-1)
    copies = pooling.high if pooling.lines else 1
    of_copy = groups.size // copies
    groups[:] = 0
    for run in range(pooling.run_cols.size):
        for copy in range(copies):
            for g in range(pooling.groups):
                begin = copy * of_copy + (run * pooling.groups + g) * size
                for lane in range(4):
                    row = first + (copy if pooling.lines else lane // 2)
                    col = pooling.run_cols[run] + (4 * g + lane if pooling.lines else lane % 2)
                    if row < pooling.rows and col < pooling.cols:
                        cell, to = (row * pooling.cols + col) * bins, begin + lane
                        for k in range(bins):
                            groups[to + 4 * (k + 1)] = cells[cell + k]
                        groups[to] = cells[cell + bins - 1]  # bins go round
                        groups[to + 4 * (bins + 1)] = cells[cell]


@compiled
def _line_of(groups: Any, row: int, pooling: Any, of_line: Any) -> None:
    """The groups of a line from those of each row of cells: the adjoint of sharing."""
    of_line[:] = 0
    for k in range(pooling.high):
        weight = pooling.shares[row, k]
        if weight != 0:
            of_row = groups[k * of_line.size : (k + 1) * of_line.size]
            for i in range(of_line.size):
                of_line[i] += weight * of_row[i]


@compiled
def _read(groups: Any, places: Any, row: int, pooling: Any, found: Any) -> None:
    """To ``found`` (width · 4,): what reaches a vote of each pixel into the bin before its own, its own, the next."""
    by_row, by_col, size = pooling.by_row, pooling.by_col, pooling.group
    weight = np.uintp(4 * row)
    for x in range(places.size):
        to, col = np.uintp(4 * x), np.uintp(4 * x * pooling.groups)
        at = np.uintp(places[x] - 4)
        read_four(groups, at, found, to, by_row, weight, by_col, col)
        for _ in range(1, pooling.groups):
            at, col = at + np.uintp(size), col + np.uintp(4)
            read_four_more(groups, at, found, to, by_row, weight, by_col, col)


@compiled
def _along(reached: Any, f: Any, m: Any, hard: bool, along: Any) -> None:
    """What reaches the logarithm of each magnitude, by the magnitude: of ``reached`` (width · 4,), between two bins."""
    one = m.dtype.type(1)
    zero = one - one
    for x in range(m.size):
        here = reached[4 * x + 1]
        here = here if hard else here + f[x] * (reached[4 * x + 2] - here)
        along[x] = here / m[x] if m[x] > zero else zero


@compiled
def _across(reached: Any, f: Any, m: Any, slope: Any, across: Any) -> None:
    """The same of each angle: the difference of two bins, on a bin centre the mean of those on both sides."""
    one, half = m.dtype.type(1), m.dtype.type(0.5)
    zero = one - one
    for x in range(m.size):
        before, here, after = reached[4 * x], reached[4 * x + 1], reached[4 * x + 2]
        change = half * (after - before) if f[x] == zero else after - here
        across[x] = slope * change / m[x] if m[x] > zero else zero


@compiled
def _turn(along: Any, across: Any, gx: Any, gy: Any, to_gx: Any, to_gy: Any) -> None:
    """What reaches the gradients, to lines between two ends."""
    for x in range(gx.size):
        to_gx[x + 1] = along[x] * gx[x] - across[x] * gy[x]
        to_gy[x + 1] = along[x] * gy[x] + across[x] * gx[x]


@compiled
def _outermost(to_gx: Any, to_gy: Any, row: int, height: int, times: Any) -> None:
    """The outermost pixels' gradients count ``times``, and not at all along an axis of one pixel."""
    width = to_gx.size - 2
    to_gx[1] *= times
    if width > 1:
        to_gx[width] *= times
    else:
        to_gx[1] = 0
    if row == 0 or row == height - 1:
        for x in range(width):
            to_gy[x + 1] *= times if height > 1 else 0


@compiled
def _masked(lines: Any, winners: Any, channel: int, found: Any) -> None:
    """Of lines (3, width + 2), where the channel won."""
    for k in range(3):
        for x in range(winners.shape[1]):
            found[k, x + 1] = lines[k, x + 1] if winners[k, x] == channel else 0


@compiled
def _central(to_gx: Any, to_gy: Any, row: int, height: int, reading: Any, found: Any) -> None:
    """What reaches a row of values from the gradients (3, width + 2) of it and the two beside it."""
    width = found.size
    line, above, below = to_gx[row % 3], to_gy[(row + 2) % 3], to_gy[(row + 1) % 3]
    for x in range(width):
        found[x] = line[x] - line[x + 2] + above[x + 1] - below[x + 1]
    if reading.times > 0 and reading.own:  # which they were compared with, too
        found[0] -= line[1]
        found[width - 1] += line[width]
        own = to_gy[row % 3]
        if row == 0:
            for x in range(width):
                found[x] -= own[x + 1]
        if row == height - 1:
            for x in range(width):
                found[x] += own[x + 1]


@compiled
def _sobel(to_gx: Any, to_gy: Any, row: int, height: int, found: Any) -> None:
    """The same for smoothed gradients of a mirrored image: the outermost rows and columns have one neighbour twice."""
    width, two = found.size, found.dtype.type(2)
    line, above, below = to_gx[row % 3], to_gx[(row + 2) % 3], to_gx[(row + 1) % 3]
    of_above, of_below = two if row == 1 else two - 1, two if row == height - 2 else two - 1
    own = two + two if height == 1 else two
    vs_above, vs_below = to_gy[(row + 2) % 3], to_gy[(row + 1) % 3]
    for x in range(width):
        found[x] = own * (line[x] - line[x + 2])
        found[x] += of_above * (above[x] - above[x + 2]) + of_below * (below[x] - below[x + 2])
        before, here, after = (
            vs_above[x] - vs_below[x],
            vs_above[x + 1] - vs_below[x + 1],
            vs_above[x + 2] - vs_below[x + 2],
        )
        found[x] += before + two * here + after
    first, last = vs_above[1] - vs_below[1], vs_above[width] - vs_below[width]
    if width == 1:
        found[0] += two * first
    else:
        found[1] += first
        found[width - 2] += last


@compiled
def _to_pixels(pixels: Any, reading: Any, weight: Any, toward: Any, found: Any) -> None:
    """From values to the pixels (width,) they were read from, by the derivative of a root if there is one."""
    real, black = found.dtype.type, found.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    for x in range(found.size):
        slope = weight * reading.scale
        if reading.root:
            value = reading.scale * real(pixels[x])
            slope = zero if value <= black else slope * half / math.sqrt(value)
        found[x] = slope * toward[x]


@compiled
def _emit(
    pixels: Any,
    at: int,
    strides: Any,
    row: int,
    height: int,
    reading: Any,
    to_gx: Any,
    to_gy: Any,
    winners: Any,
    masked: Any,
    toward: Any,
    found: Any,
) -> None:
    """One row of all channels, ``found`` (channels, height, width), from the gradients of three rows."""
    width = toward.size
    for channel in range(reading.weights.size):
        if masked.shape[0] > 0:
            _masked(to_gx, winners, channel, masked[0])
            _masked(to_gy, winners, channel, masked[1])
            us, vs = masked[0], masked[1]
        else:
            us, vs = to_gx, to_gy
        if channel == 0 or not reading.mixed:
            if reading.sobel:
                _sobel(us, vs, row, height, toward)
            else:
                _central(us, vs, row, height, reading, toward)
        begin = at + channel * strides[1] + row * strides[2]
        of_row = pixels[begin : begin + strides[3] * (width - 1) + 1 : strides[3]]
        _to_pixels(of_row, reading, reading.weights[channel], toward, found[channel, row])


@compiled
def cells_adjoint(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    given: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """Rows ``start`` to ``stop`` of one image, ``found`` (channels, height, width); ``given`` is (rows, cols, bins)."""
    height, width = shape
    real = found.dtype
    described = 1 if reading.mixed else reading.weights.size
    at_once = max(1, PIXELS_AT_ONCE // width)
    lines = np.empty((described, 3, width + 2), real)
    planes = np.empty((6, at_once * width), real)
    places, winner = np.empty(at_once * width, np.int32), np.zeros((at_once, width), np.int32)
    groups, of_line = empty_groups(pooling, planes)
    reached, toward = np.zeros(4 * width, real), np.empty(width, real)
    along, across, exact, exact_places = (
        np.empty(width, real),
        np.zeros(width, real),
        np.empty(width, real),
        np.empty(width, np.int32),
    )
    to_gx, to_gy = np.zeros((3, width + 2), real), np.zeros((3, width + 2), real)
    winners = np.zeros((3, width), np.int32)
    masked = np.zeros((2 if described > 1 else 0, 3, width + 2), real)
    row, last = max(start - 1, 0), min(stop + 1, height)  # with those beside what is asked for
    read, spread = -1, -1  # the last row of pixels that was read, the band whose cells are in the groups
    while row < last:
        band = pooling.band_of[row]
        end = row + 1 if band < 0 else min(row + at_once, pooling.bands[band, 1], last)
        size = (end - row) * width
        gx, gy, m, f = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size]
        if band >= 0:
            read = gradients_of_rows(pixels, at, shape, strides, reading, row, end, read, lines, planes, winner)
            vote_line(gx, gy, voting, planes[4, :size], planes[5, :size], m, f, places[:size])
            if band != spread:
                _spread(given, pooling, band, groups)
                spread = band
        for y in range(row, end):
            slot, line = y % 3, slice((y - row) * width, (y - row + 1) * width)
            if band < 0:
                to_gx[slot] = 0
                to_gy[slot] = 0
            else:
                us, vs, ms, fs, of_pixels = gx[line], gy[line], m[line], f[line], places[line]
                if pooling.lines:
                    _line_of(groups, y, pooling, of_line)
                cells = of_line if pooling.lines else groups
                place(of_pixels, 1, pooling.base)
                _read(cells, of_pixels, y, pooling, reached)
                _along(reached, fs, ms, voting.hard, along)
                if voting.inexact:
                    linear(us, vs, voting, exact, exact_places)
                    place(exact_places, 1, pooling.base)
                    _read(cells, exact_places, y, pooling, reached)
                    _across(reached, exact, ms, voting.slope, across)
                elif not voting.hard:
                    _across(reached, fs, ms, voting.slope, across)
                _turn(along, across, us, vs, to_gx[slot], to_gy[slot])
                _outermost(to_gx[slot], to_gy[slot], y, height, reading.times)
                winners[slot] = winner[y - row]
            if y - 1 >= start:
                _emit(pixels, at, strides, y - 1, height, reading, to_gx, to_gy, winners, masked, toward, found)
        row = end
    if stop == height:
        to_gx[height % 3] = 0
        to_gy[height % 3] = 0
        _emit(pixels, at, strides, height - 1, height, reading, to_gx, to_gy, winners, masked, toward, found)


@compiled
def adjoints_of_images(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    given: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """The same of whole images ``start`` to ``stop``, ``found`` (images, channels, height, width)."""
    for image in range(start, stop):
        begin = at + image * strides[0]
        cells_adjoint(pixels, begin, shape, strides, reading, voting, pooling, given[image], 0, shape[0], found[image])
