"""The adjoint of Eq. 1-6 in one pass: from what reaches the cell histograms to what reaches the images.

Votes are made again, which takes less than to fetch them from memory.  What reaches the gradients of three lines is
kept; a row of the image hears from the row before it, its own and the one after it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...runtime.compile import compiled, inlined
from ...runtime.simd import PADDING
from ..gradient import BLACK
from .cells import empty_lines, gradients_of_rows, most_rows, padded, rows_at_once
from .gradient_vjp_simd import central_vjp, hard_votes_vjp, votes_vjp
from .pooling_vjp import read, wrap_bins
from .pooling_vjp_simd import BESIDE
from .votes import linear, vote_line


@inlined
def _outermost(to_gx: Any, to_gy: Any, to: int, width: int, row: int, height: int, times: Any) -> None:
    """The outermost pixels' gradients count ``times``, and not at all along an axis of one pixel."""
    to_gx[to + 1] *= times
    if width > 1:
        to_gx[to + width] *= times
    else:
        to_gx[to + 1] = 0
    if row == 0 or row == height - 1:
        for x in range(width):
            to_gy[to + x + 1] *= times if height > 1 else 0


@inlined
def _masked(of: Any, winners: Any, channel: int, found: Any) -> None:
    """Of three lines, where the channel won."""
    for k in range(found.size):
        x = np.uintp(k)
        found[x] = of[x] if winners[x] == channel else 0


@inlined
def ring_line(width: int) -> int:
    """How far the lines of three rows are apart."""
    lines: int = padded(width) + PADDING
    return lines


@inlined
def _central(
    to_gx: Any, to_gy: Any, row: int, height: int, width: int, reading: Any, slope: Any, found: Any, to: int
) -> None:
    """What reaches a row of values from the gradients of it and those beside it, times ``slope``, to ``found[to:]``."""
    size = ring_line(width)
    line, above, below = row % 3 * size, (row + 2) % 3 * size, (row + 1) % 3 * size
    if width >= PADDING:
        central_vjp(to_gx, to_gy, line, above, below, width, slope, found, to)
    else:
        for x in range(width):
            reached = to_gx[line + x] - to_gx[line + x + 2] + to_gy[above + x + 1] - to_gy[below + x + 1]
            found[to + x] = slope * reached
    if reading.times > 0 and reading.own:  # which they were compared with, too
        own = row % 3 * size
        found[to] -= slope * to_gx[own + 1]
        found[to + width - 1] += slope * to_gx[own + width]
        if row == 0:
            for x in range(width):
                found[to + x] -= slope * to_gy[own + x + 1]
        if row == height - 1:
            for x in range(width):
                found[to + x] += slope * to_gy[own + x + 1]


@inlined
def _sobel(to_gx: Any, to_gy: Any, row: int, height: int, width: int, found: Any) -> None:
    """The same for smoothed gradients of a mirrored image: the outermost rows and columns have one neighbour twice."""
    size, two = ring_line(width), found.dtype.type(2)
    line, above, below = row % 3 * size, (row + 2) % 3 * size, (row + 1) % 3 * size
    of_above, of_below = two if row == 1 else two - 1, two if row == height - 2 else two - 1
    own = two + two if height == 1 else two
    for x in range(width):
        found[x] = own * (to_gx[line + x] - to_gx[line + x + 2])
        found[x] += of_above * (to_gx[above + x] - to_gx[above + x + 2])
        found[x] += of_below * (to_gx[below + x] - to_gx[below + x + 2])
        before = to_gy[above + x] - to_gy[below + x]
        here = to_gy[above + x + 1] - to_gy[below + x + 1]
        after = to_gy[above + x + 2] - to_gy[below + x + 2]
        found[x] += before + two * here + after
    first, last = to_gy[above + 1] - to_gy[below + 1], to_gy[above + width] - to_gy[below + width]
    if width == 1:
        found[0] += two * first
    else:
        found[1] += first
        found[width - 2] += last


@inlined
def _to_pixels(
    pixels: Any, begin: int, step: int, width: int, reading: Any, weight: Any, toward: Any, found: Any, to: int
) -> None:
    """From values to the pixels they were read from, by the derivative of a root if there is one."""
    real, black = found.dtype.type, found.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    place, slope = np.uintp(to), weight * reading.scale
    if reading.root:
        for x in range(width):
            value = reading.scale * real(pixels[begin + x * step])
            found[to + x] = zero if value <= black else slope * half / math.sqrt(value) * toward[x]
    else:
        for k in range(width):
            x = np.uintp(k)
            found[place + x] = slope * toward[x]


@inlined
def _emit(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    row: int,
    reading: Any,
    to_gx: Any,
    to_gy: Any,
    winners: Any,
    us: Any,
    vs: Any,
    toward: Any,
    found: Any,
) -> None:
    """One row of all channels, to ``found`` (channels · height · width), from the gradients of three rows.

    ``us`` and ``vs`` are overwritten.
    """
    height, width = shape
    mixed, several = reading.mixed, us.size > 0
    for channel in range(reading.weights.size):
        if several:
            _masked(to_gx, winners, channel, us)
            _masked(to_gy, winners, channel, vs)
        place = (channel * height + row) * width
        of_x, of_y = (us, vs) if several else (to_gx, to_gy)
        if not (reading.sobel or reading.root or mixed):
            slope = reading.weights[channel] * reading.scale
            _central(of_x, of_y, row, height, width, reading, slope, found, place)
            continue
        if channel == 0 or not mixed:
            if reading.sobel:
                _sobel(of_x, of_y, row, height, width, toward)
            else:
                one = reading.scale / reading.scale
                _central(of_x, of_y, row, height, width, reading, one, toward, 0)
        begin = at + channel * strides[1] + row * strides[2]
        _to_pixels(pixels, begin, strides[3], width, reading, reading.weights[channel], toward, found, place)


@compiled
def cells_vjp_of_images(
    pixels: Any,
    at: int,
    shape: Any,
    strides: Any,
    reading: Any,
    voting: Any,
    pooling: Any,
    given: Any,
    images: Any,
    rows: Any,
    found: Any,
) -> None:
    """Rows (first, last) of some images (first, last), to ``found`` (images, channels, height, width).

    ``given`` is (images, rows, cols, bins).
    """
    height, width = shape
    real = found.dtype
    several = not reading.mixed and reading.weights.size > 1
    stride, most = padded(width), most_rows(pooling)
    few = min(rows_at_once(stride), most)
    planes, ring = most * stride + PADDING, 3 * ring_line(width)
    lines = empty_lines(reading, width, real)
    gx, gy, m, f = np.empty(planes, real), np.empty(planes, real), np.empty(planes, real), np.empty(planes, real)
    us, vs, winner = np.empty(few * stride, real), np.empty(few * stride, real), np.empty(planes, np.int32)
    bins = np.zeros(planes, np.int32)
    before, here, after = np.empty(planes, real), np.empty(planes, real), np.empty(planes, real)
    again = planes if voting.inexact else 0
    exact, exact_bins = np.empty(again, real), np.zeros(again, np.int32)
    before_exact, here_exact, after_exact = np.empty(again, real), np.empty(again, real), np.empty(again, real)
    line = (pooling.bins + BESIDE + 7) // 8 * 8
    cells = np.zeros((pooling.high, pooling.cols + pooling.wide + 1, line), real)  # tables end behind the last
    spread = np.empty(pooling.high * (pooling.columns + PADDING) * line, real)
    to_gx, to_gy, toward = np.zeros(ring, real), np.zeros(ring, real), np.empty(width, real)
    winners = np.zeros(ring, np.int32)
    masked = ring if several else 0
    masked_x, masked_y = np.zeros(masked, real), np.zeros(masked, real)
    start, stop = rows
    for image in range(images[0], images[1]):
        of_image, of_found = at + image * strides[0], found[image].reshape(-1)
        to_gx[:] = 0
        to_gy[:] = 0
        row, last = max(start - 1, 0), stop + 1  # with those beside what is asked for, and nothing below the image
        seen = -1  # the last row of pixels
        while row < last:
            band = pooling.band_of[row] if row < height else -1
            end = row + 1 if band < 0 else min(pooling.bands[band, 1], last)
            if band >= 0:
                for begin in range(row, end, few):
                    count = (min(begin + few, end) - begin) * stride
                    part = slice((begin - row) * stride, (begin - row) * stride + count)
                    of_x, of_y = gx[part], gy[part]
                    seen = gradients_of_rows(
                        pixels,
                        of_image,
                        shape,
                        strides,
                        reading,
                        begin,
                        min(begin + few, end),
                        seen,
                        lines,
                        stride,
                        of_x,
                        of_y,
                        us,
                        vs,
                        winner[part],
                    )
                    vote_line(of_x, of_y, voting, m[part], f[part], bins[part])
                    if voting.inexact:
                        linear(of_x, of_y, voting, m[part], exact[part], exact_bins[part])
                wrap_bins(given[image], pooling, band, cells)
                read(cells, bins, stride, row, end - row, pooling, spread, before, here, after)
                if voting.inexact:
                    read(
                        cells,
                        exact_bins,
                        stride,
                        row,
                        end - row,
                        pooling,
                        spread,
                        before_exact,
                        here_exact,
                        after_exact,
                    )
            for y in range(row, end):
                slot, of_row = y % 3 * ring_line(width), (y - row) * stride
                if band < 0:
                    to_gx[slot : slot + width + 2] = 0
                    to_gy[slot : slot + width + 2] = 0
                else:
                    of_angle = (
                        (exact, before_exact, here_exact, after_exact) if voting.inexact else (f, before, here, after)
                    )
                    votes = m, f, here, after, *of_angle, gx, gy
                    if voting.hard:
                        hard_votes_vjp(*votes, of_row, width, voting.slope, to_gx, to_gy, slot)
                    else:
                        votes_vjp(*votes, of_row, width, voting.slope, to_gx, to_gy, slot)
                    _outermost(to_gx, to_gy, slot, width, y, height, reading.times)
                    if several:
                        winners[slot + 1 : slot + width + 1] = winner[of_row : of_row + width]
                if y - 1 >= start:
                    _emit(
                        pixels,
                        of_image,
                        shape,
                        strides,
                        y - 1,
                        reading,
                        to_gx,
                        to_gy,
                        winners,
                        masked_x,
                        masked_y,
                        toward,
                        of_found,
                    )
            row = end
