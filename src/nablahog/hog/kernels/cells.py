"""Eq. 1-6 in one pass over the images, and their derivatives in another: images -> cell histograms.

A pixel votes into two orientation bins of two rows by two columns of cells.  Dense over bins, as in the plain steps,
that takes some thirty passes over planes in memory.  Here three lines of pixels are in a processor's cache, and with
them the histograms of one band: the rows of pixels that vote into the same rows of cells.  Columns that vote into the
same cells do not follow each other: a sum in memory must have arrived before it can be added to.  The derivatives
compute the votes once more, which takes less than to fetch them from memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compile import compiled
from .lanes import add_one, add_two, collect_four
from .lines import central, choose, edges, read_line, sobel
from .votes import vote_line

PIXELS_AT_ONCE = 1024  # whose votes are made in one go


@compiled
def _read_row(pixels: Any, at: int, strides: Any, row: int, reading: Any, lines: Any) -> None:
    """One row of pixels of all channels to ``lines`` (channels described, 3, width + 2)."""
    for channel in range(reading.weights.size):
        line = lines[0 if reading.mixed else channel, row % 3]
        first = channel == 0 or not reading.mixed
        begin = at + channel * strides[1] + row * strides[2]
        weight = reading.weights[channel]
        width, step = line.size - 2, strides[3]
        if step == 1:
            read_line(pixels[begin : begin + width], reading.scale, weight, first, reading.root, line)
        else:
            read_line(pixels[begin : begin + step * width : step], reading.scale, weight, first, reading.root, line)


@compiled
def gradient_of_line(lines: Any, row: int, height: int, reading: Any, gx: Any, gy: Any) -> None:
    """Gradients of one line, of one channel's ``lines`` (3, width + 2)."""
    above, line, below = lines[abs(row - 1) % 3], lines[row % 3], lines[(row + 1) % 3]
    if row == 0:
        above = lines[min(1, height - 1)]
    if row == height - 1:
        below = lines[max(height - 2, 0) % 3]
    if reading.sobel:
        sobel(above, line, below, gx, gy)
    else:
        central(above, line, below, gx, gy)
    if reading.times > 0:
        outermost = row == 0, row == height - 1
        edges(above, line, below, *outermost, reading.times, reading.own, reading.beyond, gx, gy)


@compiled
def _strongest(
    lines: Any, row: int, height: int, reading: Any, gx: Any, gy: Any, us: Any, vs: Any, winner: Any
) -> None:
    """The gradient of largest magnitude among the channels, and which it is; ``us`` and ``vs`` are overwritten."""
    gradient_of_line(lines[0], row, height, reading, gx, gy)
    if lines.shape[0] > 1:
        winner[:] = 0
    for channel in range(1, lines.shape[0]):
        gradient_of_line(lines[channel], row, height, reading, us, vs)
        choose(us, vs, channel, reading.last_wins, gx, gy, winner)


@compiled
def place(bins: Any, rows: int, base: Any) -> None:
    """From bins of some rows to where they are among the groups of their runs: there is one before the first."""
    for row in range(rows):
        of_row = bins[row * base.size : (row + 1) * base.size]
        for x in range(base.size):
            of_row[x] = base[x] + 4 * (of_row[x] + 1)


@compiled
def rows_at_once(pooling: Any, width: int) -> int:
    """Whose votes are made in one go: whole bands if lines are shared out, to come back to few groups at a time."""
    highest = 1
    if pooling.lines:
        for band in range(pooling.bands.shape[0]):
            highest = max(highest, pooling.bands[band, 1] - pooling.bands[band, 0])
    return max(highest, PIXELS_AT_ONCE // width)


@compiled
def empty_groups(pooling: Any, like: Any) -> Any:
    """The groups of a band and, if lines are shared out, of a line; of some more, zeros may be read and added to."""
    of_all_runs = (pooling.run_cols.size * pooling.groups + 4) * pooling.group
    groups = np.zeros((pooling.high if pooling.lines else 1) * of_all_runs, like.dtype)
    return groups, np.zeros(of_all_runs if pooling.lines else 0, like.dtype)


@compiled
def _vote(
    m: Any, f: Any, places: Any, skipped: int, row: int, part: int, hard: bool, pooling: Any, groups: Any
) -> None:
    """Eq. 5: adds votes of a part of a line to its groups; the line is ``skipped`` pixels from the first of ``m``."""
    by_row, by_col, size = pooling.by_row, pooling.by_col, pooling.group
    weight = np.uintp(4 * row)
    for k in range(pooling.parts[part, 0], pooling.parts[part, 1]):
        x = np.uintp(pooling.order[k])
        pixel, col = x + np.uintp(skipped), x * np.uintp(4 * pooling.groups)
        place = np.uintp(places[pixel])
        for _ in range(pooling.groups):
            if hard:
                add_one(groups, place, m[pixel], by_row, weight, by_col, col)
            else:
                far = m[pixel] * f[pixel]
                add_two(groups, place, m[pixel] - far, far, by_row, weight, by_col, col)
            place, col = place + np.uintp(size), col + np.uintp(4)


@compiled
def share(of_line: Any, row: int, part: int, pooling: Any, groups: Any) -> None:
    """Adds the groups of a part of a line to those of each row of cells, one row after the other in ``groups``."""
    begin, end = pooling.parts[part, 2], pooling.parts[part, 3]
    votes = of_line[begin:end]
    for k in range(pooling.high):
        weight = pooling.shares[row, k]
        if weight != 0:
            of_row = groups[k * of_line.size + begin : k * of_line.size + end]
            for i in range(votes.size):
                of_row[i] += weight * votes[i]
    votes[:] = 0


@compiled
def add_lanes(groups: Any, at: int, cells: Any, p: int, q: int, r: int, s: int) -> None:
    """Adds one bin's lanes to four cells' bins."""
    cells[p] += groups[at]
    cells[q] += groups[at + 1]
    cells[r] += groups[at + 2]
    cells[s] += groups[at + 3]


@compiled
def collect(groups: Any, pooling: Any, of_band: Any) -> None:
    """Moves the groups of a band to its cells ``of_band`` (high, columns + wide, bins).

    ``groups`` are those of all runs, of one row of cells after the other if lanes are columns only.
    """
    bins, size = pooling.bins, pooling.group
    cells = of_band.reshape(-1)
    of_row = of_band.shape[1] * bins
    copies = pooling.high if pooling.lines else 1
    of_copy = groups.size // copies
    cells[:] = 0
    for run in range(pooling.run_cols.size):
        for copy in range(copies):
            for g in range(pooling.groups):
                begin = copy * of_copy + (run * pooling.groups + g) * size
                col = pooling.run_cols[run] + 4 * g
                p = copy * of_row + col * bins  # of the four lanes' cells
                q = p + bins
                r = q + bins if pooling.lines else p + of_row
                s = r + bins
                for k in range(0, bins - 3, 4):
                    collect_four(groups, begin + 4 * (k + 1), cells, p + k, q + k, r + k, s + k)
                for k in range(bins // 4 * 4, bins):
                    add_lanes(groups, begin + 4 * (k + 1), cells, p + k, q + k, r + k, s + k)
                add_lanes(groups, begin, cells, p + bins - 1, q + bins - 1, r + bins - 1, s + bins - 1)
                add_lanes(groups, begin + 4 * (bins + 1), cells, p, q, r, s)
    groups[:] = 0


@compiled
def gradients_of_rows(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    begin: int,
    end: int,
    read: int,
    lines: Any,
    planes: Any,
    winner: Any,
) -> int:
    """Eq. 1-2: gradients of rows ``begin`` to ``end`` to the first two ``planes``; returns the last row that was read.

    ``lines`` (channels described, 3, width + 2) hold what was read of the rows up to ``read``.
    """
    height, width = shape
    read = max(read, begin - 2)
    for row in range(begin, end):
        while read < min(row + 1, height - 1):
            read += 1
            _read_row(pixels, at, strides, read, reading, lines)
        line = slice((row - begin) * width, (row - begin + 1) * width)
        gx, gy, us, vs = planes[0, line], planes[1, line], planes[4, line], planes[5, line]
        _strongest(lines, row, height, reading, gx, gy, us, vs, winner[row - begin])
    return read


@compiled
def cells(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """Cells of bands ``start`` to ``stop`` of one image, to ``found`` (bands, rows, columns, bins)."""
    width = shape[1]
    real = found.dtype
    described = 1 if reading.mixed else reading.weights.size
    at_once = rows_at_once(pooling, width)
    lines = np.empty((described, 3, width + 2), real)
    planes = np.empty((6, at_once * width), real)
    places, winner = np.empty(at_once * width, np.int32), np.empty((at_once, width), np.int32)
    groups, of_line = empty_groups(pooling, planes)
    read = -1
    for band in range(start, stop):
        first, last, _ = pooling.bands[band]
        for begin in range(first, last, at_once):
            end = min(begin + at_once, last)
            read = gradients_of_rows(pixels, at, shape, strides, reading, begin, end, read, lines, planes, winner)
            size = (end - begin) * width
            gx, gy, m, f = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size]
            vote_line(gx, gy, voting, planes[4, :size], planes[5, :size], m, f, places[:size])
            place(places, end - begin, pooling.base)
            for part in range(pooling.parts.shape[0]):
                for row in range(begin, end):
                    skipped = (row - begin) * width
                    if pooling.lines:
                        _vote(m, f, places, skipped, row, part, voting.hard, pooling, of_line)
                        share(of_line, row, part, pooling, groups)
                    else:
                        _vote(m, f, places, skipped, row, part, voting.hard, pooling, groups)
        collect(groups, pooling, found[band])


@compiled
def add_bands(of_bands: Any, pooling: Any, found: Any) -> None:
    """Eq. 6: cells of bands to those of the image, ``found`` (rows, columns, bins)."""
    found[:] = 0
    for band in range(pooling.bands.shape[0]):
        first = pooling.bands[band, 2]
        for row in range(first, min(first + of_bands.shape[1], pooling.rows)):
            for col in range(pooling.cols):
                for k in range(pooling.bins):
                    found[row, col, k] += of_bands[band, row - first, col, k]


@compiled
def cells_of_images(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """Cells of images ``start`` to ``stop``, to ``found`` (images, rows, columns, bins)."""
    bands = pooling.bands.shape[0]
    of_bands = np.empty((bands, pooling.high, pooling.cols + pooling.wide, pooling.bins), found.dtype)
    for image in range(start, stop):
        begin = at + image * strides[0]
        cells(pixels, begin, shape, strides, reading, voting, pooling, 0, bands, of_bands)
        add_bands(of_bands, pooling, found[image])
