"""Eq. 1-6 and how they change with the image, in one pass: the derivative in forward mode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...runtime.compile import compiled
from ...runtime.simd import PADDING
from ..gradient import BLACK
from .cells import (
    add_bands,
    count_of_sums,
    empty_lines,
    gradient_of_line,
    gradients_of_rows,
    most_rows,
    padded,
    pool,
)
from .pooling_simd import BINS, sum_changes, sum_changes_once
from .votes import linear, vote_line


@compiled
def _read_changes(
    pixels: Any, at: int, shape: Any, strides: Any, changes: Any, row: int, reading: Any, lines: Any
) -> None:
    """One row of ``changes`` (channels, height, width) of the pixels, to lines of changes of values."""
    width = shape[1]
    real, black = lines.dtype.type, lines.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    for channel in range(reading.weights.size):
        to = ((0 if reading.mixed else 3 * channel) + row % 3) * (width + 2)
        begin = at + channel * strides[1] + row * strides[2]
        first = channel == 0 or not reading.mixed
        for x in range(width):
            slope = reading.weights[channel] * reading.scale
            if reading.root:
                value = reading.scale * real(pixels[begin + x * strides[3]])
                slope = zero if value <= black else slope * half / math.sqrt(value)
            change = slope * changes[channel, row, x]
            lines[to + x + 1] = change if first else lines[to + x + 1] + change
        lines[to], lines[to + width + 1] = lines[to + min(2, width)], lines[to + max(width - 1, 1)]


@compiled
def _chosen(us: Any, vs: Any, channel: int, winner: Any, dx: Any, dy: Any) -> None:
    """Replaces changes of gradients by the channel's where it won."""
    for x in range(dx.size):
        dx[x] = us[x] if winner[x] == channel else dx[x]
        dy[x] = vs[x] if winner[x] == channel else dy[x]


@compiled
def _changes_by_size(
    gx: Any, gy: Any, dx: Any, dy: Any, m: Any, f: Any, hard: bool, here: Any, after: Any, before: Any
) -> None:
    """How votes change by the magnitude: for a bin and the next."""
    zero = m.dtype.type(0)
    for x in range(m.size):
        longer = (gx[x] * dx[x] + gy[x] * dy[x]) / m[x] if m[x] > zero else zero
        far = zero if hard else longer * f[x]
        here[x], after[x], before[x] = longer - far, far, zero


@compiled
def _changes_by_angle(
    gx: Any, gy: Any, dx: Any, dy: Any, m: Any, exact: Any, slope: Any, here: Any, after: Any, before: Any
) -> None:
    """How votes change by the angle: for a bin and those beside it.  On a bin centre the mean of both sides."""
    half, zero = m.dtype.type(0.5), m.dtype.type(0)
    for x in range(m.size):
        turned = slope * (gx[x] * dy[x] - gy[x] * dx[x]) / m[x] if m[x] > zero else zero
        centre = exact[x] == zero
        here[x] = zero if centre else -turned
        after[x] = half * turned if centre else turned
        before[x] = -half * turned if centre else zero


@compiled
def _add(
    here: Any,
    after: Any,
    before: Any,
    bins: Any,
    stride: int,
    first: int,
    rows: int,
    pooling: Any,
    sums: Any,
    of_band: Any,
) -> None:
    """Eq. 5-6 of changes: adds them to the cells of a band."""
    high, count, last = pooling.high, pooling.bins, pooling.bins - 1
    size, by_row = padded(pooling.columns), pooling.by_row
    of_row = count * size
    for part in range(pooling.parts.shape[0]):
        begin, end = pooling.runs[pooling.parts[part, 0], 0], pooling.runs[pooling.parts[part, 1] - 1, 1]
        for row in range(0, high, 2):
            share = first * high + row
            for bin_ in range(0, count, BINS):
                few = min(BINS, count - bin_)
                for x in range(begin, end, pooling.at_once):
                    to = (row * count + bin_) * size + x - begin
                    columns = bins, x, stride, rows, by_row, share, high, bin_, last, few, sums, to, size, of_row
                    if high == 1:
                        sum_changes_once(here, after, before, *columns)
                    else:
                        sum_changes(here, after, before, *columns)
        pool(sums, part, pooling, of_band)


@compiled
def _cells_jvp(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    changes: Any,
    reading: Any,
    beyond: Any,
    voting: Any,
    pooling: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """How cells of bands ``start`` to ``stop`` of one image change, to ``found`` (bands, of_band).

    ``changes`` (channels, height, width) are the pixels'; ``beyond`` is ``reading`` of an image that has nothing there.
    """
    height, width = shape
    real = found.dtype
    described = 1 if reading.mixed else reading.weights.size
    stride, most = padded(width), most_rows(pooling)
    planes = most * stride + PADDING
    lines, moved = empty_lines(reading, width, real), empty_lines(reading, width, real)
    sums = np.zeros(count_of_sums(pooling), real)
    gx, gy, dx, dy = np.zeros(planes, real), np.zeros(planes, real), np.zeros(planes, real), np.zeros(planes, real)
    us, vs, m, f = np.zeros(planes, real), np.zeros(planes, real), np.zeros(planes, real), np.zeros(planes, real)
    here, after, before = np.zeros(planes, real), np.zeros(planes, real), np.zeros(planes, real)
    bins, winner = np.zeros(planes, np.int32), np.zeros(planes, np.int32)
    exact, exact_bins = np.zeros(planes, real), np.zeros(planes, np.int32)
    read, moved_read = -1, -1
    for band in range(start, stop):
        first, last, _ = pooling.bands[band]
        read = gradients_of_rows(
            pixels, at, shape, strides, reading, first, last, read, lines, stride, gx, gy, us, vs, winner
        )
        vote_line(gx, gy, voting, m, f, bins)
        moved_read = max(moved_read, first - 2)
        for row in range(first, last):
            while moved_read < min(row + 1, height - 1):
                moved_read += 1
                _read_changes(pixels, at, shape, strides, changes, moved_read, reading, moved)
            to = (row - first) * stride
            gradient_of_line(moved, 0, row, shape, beyond, dx, dy, to)
            for channel in range(1, described):
                gradient_of_line(moved, channel, row, shape, beyond, us, vs, to)
                line = slice(to, to + width)
                _chosen(us[line], vs[line], channel, winner[line], dx[line], dy[line])
        cells = found[band]
        cells[:] = 0
        rows = last - first
        _changes_by_size(gx, gy, dx, dy, m, f, voting.hard, here, after, before)
        _add(here, after, before, bins, stride, first, rows, pooling, sums, cells)
        if not voting.hard:
            if voting.inexact:
                linear(gx, gy, voting, m, exact, exact_bins)
            else:
                exact[:] = f
                exact_bins[:] = bins
            _changes_by_angle(gx, gy, dx, dy, m, exact, voting.slope, here, after, before)
            _add(here, after, before, exact_bins, stride, first, rows, pooling, sums, cells)


@compiled
def cells_jvp_of_images(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    changes: Any,
    reading: Any,
    beyond: Any,
    voting: Any,
    pooling: Any,
    start: int,
    stop: int,
    found: Any,
) -> None:
    """The same of images ``start`` to ``stop``, to ``found`` (images, rows, columns, bins)."""
    bands = pooling.bands.shape[0]
    of_bands = np.empty((bands, (pooling.cols + pooling.wide) * pooling.of_cell), found.dtype)
    for image in range(start, stop):
        begin = at + image * strides[0]
        _cells_jvp(pixels, begin, shape, strides, changes[image], reading, beyond, voting, pooling, 0, bands, of_bands)
        add_bands(of_bands, pooling, found[image])
