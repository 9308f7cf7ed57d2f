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
from .lanes import add_one, add_two
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
def place(bins: Any, base: Any) -> None:
    """From bins to where they are among the groups of their runs: there is one before the first."""
    for x in range(bins.size):
        bins[x] = base[x] + 4 * (bins[x] + 1)


@compiled
def _vote(m: Any, f: Any, places: Any, row: int, hard: bool, pooling: Any, groups: Any) -> None:
    """Eq. 5: adds the votes of a line to its groups."""
    by_row, by_col, size = pooling.by_row, pooling.by_col, pooling.group
    weight = np.uintp(4 * row)
    for k in range(pooling.order.size):
        x = np.uintp(pooling.order[k])
        place, col = np.uintp(places[x]), x * np.uintp(4 * pooling.groups)
        for _ in range(pooling.groups):
            if hard:
                add_one(groups, place, m[x], by_row, weight, by_col, col)
            else:
                far = m[x] * f[x]
                add_two(groups, place, m[x] - far, far, by_row, weight, by_col, col)
            place, col = place + np.uintp(size), col + np.uintp(4)


@compiled
def share(of_line: Any, weights: Any, of_band: Any) -> None:
    """Adds the groups of a line to those of each row of cells, ``of_band`` (high, groups of all runs)."""
    for row in range(weights.size):
        weight = weights[row]
        if weight != 0:
            for k in range(of_line.size):
                of_band[row, k] += weight * of_line[k]
    of_line[:] = 0


@compiled
def _collect_lane(group: Any, lane: int, bins: int, cell: Any) -> None:
    """Adds one cell's lane of a group to the cell (bins,)."""
    for k in range(bins):
        cell[k] += group[4 * (k + 1) + lane]
    cell[bins - 1] += group[lane]
    cell[0] += group[4 * (bins + 1) + lane]


@compiled
def collect(groups: Any, pooling: Any, of_band: Any) -> None:
    """Moves the groups (high or 1, of all runs) of a band to its cells ``of_band`` (high, columns + wide, bins)."""
    bins, size = pooling.bins, pooling.group
    of_band[:] = 0
    for run in range(pooling.run_cols.size):
        col = pooling.run_cols[run]
        for g in range(pooling.groups):
            begin = (run * pooling.groups + g) * size
            for lane in range(4):
                if pooling.lines:
                    for row in range(pooling.high):
                        group = groups[row, begin : begin + size]
                        _collect_lane(group, lane, bins, of_band[row, col + 4 * g + lane])
                else:
                    group = groups[0, begin : begin + size]
                    _collect_lane(group, lane, bins, of_band[lane // 2, col + lane % 2])
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
    at_once = max(1, PIXELS_AT_ONCE // width)  # rows
    lines = np.empty((described, 3, width + 2), real)
    planes = np.empty((6, at_once * width), real)
    places, winner = np.empty(at_once * width, np.int32), np.empty((at_once, width), np.int32)
    of_all_runs = pooling.run_cols.size * pooling.groups * pooling.group
    groups = np.zeros((pooling.high if pooling.lines else 1, of_all_runs + 4 * pooling.group), real)
    of_line = np.zeros(groups.shape[1] if pooling.lines else 0, real)
    read = -1
    for band in range(start, stop):
        first, last, _ = pooling.bands[band]
        for begin in range(first, last, at_once):
            end = min(begin + at_once, last)
            read = gradients_of_rows(pixels, at, shape, strides, reading, begin, end, read, lines, planes, winner)
            size = (end - begin) * width
            gx, gy, m, f = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size]
            vote_line(gx, gy, voting, planes[4, :size], planes[5, :size], m, f, places[:size])
            for row in range(begin, end):
                line = slice((row - begin) * width, (row - begin + 1) * width)
                place(places[line], pooling.base)
                if pooling.lines:
                    _vote(m[line], f[line], places[line], row, voting.hard, pooling, of_line)
                    share(of_line, pooling.share[row], groups)
                else:
                    _vote(m[line], f[line], places[line], row, voting.hard, pooling, groups[0])
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
