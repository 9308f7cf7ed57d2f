"""Eq. 1-6 in one pass over an image: from stored values to cell histograms, a band of rows at a time.

The rows of a band share their cells.  What its pixels vote is kept until all of them are read; then they are summed up
in parts of a few columns.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...runtime.compile import compiled, inlined
from ...runtime.simd import PADDING
from .gradient_loops import central, choose, edges, read_line, sobel
from .pooling_simd import BINS, pool_eight, pool_eight_once, sum_hard, sum_hard_once, sum_linear, sum_linear_once
from .votes import vote_line

PIXELS_AT_ONCE = 1024  # whose gradients and votes stay in a processor's first cache


@inlined
def padded(count: int) -> int:
    """Rounded up to whole vectors."""
    return (count + PADDING - 1) // PADDING * PADDING


@inlined
def _read_row(pixels: Any, at: int, shape: Any, strides: Any, row: int, reading: Any, lines: Any) -> None:
    """One row of pixels of all channels to ``lines``: of each channel that is described, three of width + 2."""
    width, weights = shape[1], reading.weights
    scale, mixed, root = reading.scale, reading.mixed, reading.root
    for channel in range(weights.size):
        to = ((0 if mixed else 3 * channel) + row % 3) * (width + 2)
        first = channel == 0 or not mixed
        begin = at + channel * strides[1] + row * strides[2]
        read_line(pixels, begin, strides[3], width, scale, weights[channel], first, root, lines, to)


@inlined
def gradient_of_line(lines: Any, channel: int, row: int, shape: Any, reading: Any, gx: Any, gy: Any, to: int) -> None:
    """Gradients of one row of one channel, to ``gx[to:]`` and ``gy[to:]``."""
    height, width = shape
    slots = max(row - 1, 0), row, min(row + 1, height - 1)
    if row == 0:
        slots = min(1, height - 1), row, min(1, height - 1)
    elif row == height - 1:
        slots = height - 2, row, height - 2
    above, line, below = slots
    begin, size = 3 * channel, width + 2
    above, line, below = (begin + above % 3) * size, (begin + line % 3) * size, (begin + below % 3) * size
    if reading.sobel:
        sobel(lines, above, line, below, width, gx, gy, to)
    else:
        central(lines, above, line, below, width, gx, gy, to)
    if reading.times > 0:
        first, last = row == 0, row == height - 1
        times, own, beyond = reading.times, reading.own, reading.beyond
        edges(lines, above, line, below, width, first, last, times, own, beyond, gx, gy, to)


@inlined
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
    stride: int,
    gx: Any,
    gy: Any,
    us: Any,
    vs: Any,
    winner: Any,
) -> int:
    """Eq. 1-2: gradients of rows ``begin`` to ``end``, ``stride`` apart; returns the last row that was read.

    They are of the channel of largest magnitude, which ``winner`` names if there are several.  ``lines`` hold what was
    read of the rows up to ``read``; ``us`` and ``vs`` are overwritten.
    """
    height, width = shape
    described = 1 if reading.mixed else reading.weights.size
    read = max(read, begin - 2)
    for row in range(begin, end):
        while read < min(row + 1, height - 1):
            read += 1
            _read_row(pixels, at, shape, strides, read, reading, lines)
        to = (row - begin) * stride
        gradient_of_line(lines, 0, row, shape, reading, gx, gy, to)
        if described > 1:
            winner[to : to + width] = 0
        for channel in range(1, described):
            gradient_of_line(lines, channel, row, shape, reading, us, vs, 0)
            choose(us, vs, channel, reading.last_wins, width, gx, gy, to, winner, to)
    return read


@inlined
def rows_at_once(stride: int) -> int:
    return max(1, PIXELS_AT_ONCE // stride)


@inlined
def most_rows(pooling: Any) -> int:
    """Of a band."""
    most = 1
    for band in range(pooling.bands.shape[0]):
        most = max(most, pooling.bands[band, 1] - pooling.bands[band, 0])
    return most


@inlined
def empty_lines(reading: Any, width: int, like: Any) -> Any:
    """For three rows of values of each channel that is described."""
    return np.zeros((1 if reading.mixed else reading.weights.size) * 3 * (width + 2), like)


@inlined
def count_of_sums(pooling: Any) -> int:
    """Of a part's columns, of each row of cells and bin."""
    count: int = pooling.of_cell * padded(pooling.columns) + PADDING
    return count


@compiled
def pool(sums: Any, part: int, pooling: Any, of_band: Any) -> None:
    """Adds the sums of a part's columns to the cells ``of_band``, (columns + wide, of_cell)."""
    size, wide, length, of_cell = padded(pooling.columns), pooling.wide, pooling.length, pooling.of_cell
    first, last = pooling.parts[part]
    begin = pooling.runs[first, 0]
    for run in range(first, last):
        start, stop, cell = pooling.runs[run]
        for x in range(start, stop, 8):
            for pair in range(0, wide, 2):
                share, to = (run * wide + pair) * length + x - start, (cell + pair) * of_cell
                for k in range(0, of_cell, 8):
                    at = k * size + x - begin
                    if wide == 1:
                        pool_eight_once(sums, at, size, pooling.by_col, share, length, of_band, to + k, of_cell)
                    else:
                        pool_eight(sums, at, size, pooling.by_col, share, length, of_band, to + k, of_cell)


@compiled
def sum_up(
    m: Any, f: Any, bins: Any, stride: int, first: int, rows: int, hard: bool, pooling: Any, sums: Any, of_band: Any
) -> None:
    """Eq. 5-6: cells of a band, ``of_band``, from the votes of its ``rows`` from the ``first`` on."""
    high, count, last = pooling.high, pooling.bins, pooling.bins - 1
    size, by_row = padded(pooling.columns), pooling.by_row
    of_row = count * size
    of_band[:] = 0
    for part in range(pooling.parts.shape[0]):
        begin, end = pooling.runs[pooling.parts[part, 0], 0], pooling.runs[pooling.parts[part, 1] - 1, 1]
        for row in range(0, high, 2):
            share = first * high + row
            for bin_ in range(0, count, BINS):
                few = min(BINS, count - bin_)
                to = (row * count + bin_) * size - begin
                rest = rows, by_row, share, high, bin_, last, few, sums
                at_once = pooling.at_once
                if hard and high == 1:
                    for x in range(begin, end, at_once):
                        sum_hard_once(m, bins, x, stride, *rest, to + x, size, of_row)
                elif hard:
                    for x in range(begin, end, at_once):
                        sum_hard(m, bins, x, stride, *rest, to + x, size, of_row)
                elif high == 1:
                    for x in range(begin, end, at_once):
                        sum_linear_once(m, f, bins, x, stride, *rest, to + x, size, of_row)
                else:
                    for x in range(begin, end, at_once):
                        sum_linear(m, f, bins, x, stride, *rest, to + x, size, of_row)
        pool(sums, part, pooling, of_band)


@inlined
def add_band(of_band: Any, band: int, pooling: Any, found: Any) -> None:
    """Eq. 6: adds the cells of a band to those of the image, ``found`` (rows, columns, bins)."""
    bins, first, to_all = pooling.bins, pooling.bands[band, 2], found.reshape(-1)
    for row in range(first, min(first + pooling.high, pooling.rows)):
        to, at = np.uintp(row * pooling.cols * bins), np.uintp((row - first) * bins)
        for _ in range(pooling.cols):
            for k in range(bins):
                to_all[to + np.uintp(k)] += of_band[at + np.uintp(k)]
            to, at = to + np.uintp(bins), at + np.uintp(pooling.of_cell)


@compiled
def add_bands(of_bands: Any, pooling: Any, found: Any) -> None:
    """The same of all bands, to nothing."""
    found[:] = 0
    for band in range(pooling.bands.shape[0]):
        add_band(of_bands[band], band, pooling, found)


@compiled
def cells_of_images(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    images: Any,
    bands: Any,
    of_bands: Any,
    found: Any,
) -> None:
    """Cells of some images (first, last) and bands of them (first, last), to ``found`` (images, rows, columns, bins).

    If ``found`` is of no images, the bands of one are left in ``of_bands`` (bands, columns + wide, of_cell) in lines;
    else that has room for one band.
    """
    width = shape[1]
    real = of_bands.dtype
    stride, most = padded(width), most_rows(pooling)
    few = min(rows_at_once(stride), most)
    lines, sums = empty_lines(reading, width, real), np.empty(count_of_sums(pooling), real)
    gx, gy = np.zeros(few * stride, real), np.zeros(few * stride, real)
    several = few * stride if reading.weights.size > 1 and not reading.mixed else 0
    us, vs, winner = np.zeros(several, real), np.zeros(several, real), np.zeros(several, np.int32)
    size = most * stride + PADDING
    m, f, bins = np.empty(size, real), np.empty(size, real), np.zeros(size, np.int32)
    hard = voting.hard or pooling.bins == 1
    for image in range(images[0], images[1]):
        of_image, read = at + image * strides[0], -1
        for plane in (m, f, sums):  # a NaN that the image before left there would not vanish by a weight of zero
            plane[:] = 0
        if found.shape[0] > 0:
            found[image] = 0
        for band in range(bands[0], bands[1]):
            first, last, _ = pooling.bands[band]
            for begin in range(first, last, few):
                end = min(begin + few, last)
                read = gradients_of_rows(
                    pixels, of_image, shape, strides, reading, begin, end, read, lines, stride, gx, gy, us, vs, winner
                )
                count = (end - begin) * stride
                chunk = slice((begin - first) * stride, (begin - first) * stride + count)
                vote_line(gx[:count], gy[:count], voting, m[chunk], f[chunk], bins[chunk])
            of_band = of_bands[band % of_bands.shape[0]]
            sum_up(m, f, bins, stride, first, last - first, hard, pooling, sums, of_band)
            if found.shape[0] > 0:
                add_band(of_band, band, pooling, found[image])
