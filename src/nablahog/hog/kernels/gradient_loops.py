"""Eq. 1-2 compiled, a row of pixels at a time: stored values to gradients.

A *line* holds the values of one row between two more, which mirror it at the outermost pixels.  Lines are parts of one
array, told apart by where they begin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Flags, Floats, Integers
from ...runtime.compile import inlined
from ...runtime.simd import PADDING, aligned_zeros, whole_vectors
from ..gradient import BLACK
from .parameters import Pixels, Reading


class Gradients(NamedTuple):
    """Workspace of :func:`gradients_of_rows`.  Planes hold rows of pixels, ``padded(width)`` apart."""

    lines: Floats  # (channels · 3 · (width + 2),): a ring buffer of the last three rows read, of each channel
    gx: Floats  # plane
    gy: Floats  # plane
    winner: Integers  # plane: the channel of each gradient, if there are several
    other_gx: Floats  # plane of one row: gradients of one channel
    other_gy: Floats
    values: Floats  # (width,): the row that is read


class Rows(NamedTuple):
    """Where the lines of three neighbouring rows begin."""

    above: int
    here: int
    below: int


padded = inlined(whole_vectors)


def new_gradients(reading: Reading, width: int, rows: int, dtype: DType) -> Gradients:
    """For so many rows at a time."""
    size = rows * whole_vectors(width) + PADDING
    several = size if reading.channels > 1 else 0
    lines, values = aligned_zeros(reading.channels * 3 * (width + 2), dtype), aligned_zeros(width, dtype)
    gx, gy, other_gx, other_gy = (aligned_zeros(n, dtype) for n in (size, size, several, several))
    return Gradients(lines, gx, gy, aligned_zeros(several, np.int32), other_gx, other_gy, values)


@inlined
def stored_values(pixels: Pixels, begin: int, out: Floats) -> None:
    """The row of pixels at ``begin`` as floating point.

    Rows without gaps have loops of their own, which LLVM vectorises.
    """
    real, at, step = out.dtype.type, np.uintp(begin), np.uintp(pixels.strides[3])
    values, stored = pixels.values, pixels.bytes
    if stored.size > 0 and step == 1:
        for k in range(out.size):
            out[np.uintp(k)] = real(stored[at + np.uintp(k)])
    elif stored.size > 0:
        for k in range(out.size):
            out[np.uintp(k)] = real(stored[at + np.uintp(k) * step])
    elif step == 1:
        for k in range(out.size):
            out[np.uintp(k)] = values[at + np.uintp(k)]
    else:
        for k in range(out.size):
            out[np.uintp(k)] = values[at + np.uintp(k) * step]


@inlined
def _read_line(values: Floats, reading: Reading, channel: int, first: bool, lines: Floats, to: int) -> None:
    """A row of stored ``values`` to the line at ``lines[to:]``, or added to it if not ``first``.

    The channel's weight in Eq. 1 applies to the square roots if there are any.
    """
    real = lines.dtype.type
    zero, black, scale, weight = real(0), real(BLACK), reading.scale, reading.weights[channel]
    place, width, sqrt = np.uintp(to + 1), values.size, reading.sqrt
    for k in range(width):
        x = np.uintp(k)
        value = scale * values[x]
        if sqrt:
            value = zero if value <= black else math.sqrt(value)
        value = weight * value
        lines[place + x] = value if first else lines[place + x] + value
    lines[to], lines[to + width + 1] = lines[to + min(2, width)], lines[to + max(width - 1, 1)]


@inlined
def _read_row(pixels: Pixels, start: int, row: int, reading: Reading, values: Floats, lines: Floats) -> None:
    """One row of pixels of all channels, to its lines in the ring buffer."""
    for channel in range(reading.weights.size):
        to = ((0 if reading.averaged else 3 * channel) + row % 3) * (pixels.width + 2)
        begin = start + channel * pixels.strides[1] + row * pixels.strides[2]
        stored_values(pixels, begin, values)
        _read_line(values, reading, channel, channel == 0 or not reading.averaged, lines, to)


@inlined
def _central(lines: Floats, rows: Rows, width: int, gx: Floats, gy: Floats, to: int) -> None:
    """Eq. 2: the mask [-1, 0, 1] along either axis."""
    left, up, down, place = np.uintp(rows.here), np.uintp(rows.above + 1), np.uintp(rows.below + 1), np.uintp(to)
    right = np.uintp(rows.here + 2)
    for k in range(width):
        x = np.uintp(k)
        gx[place + x] = lines[right + x] - lines[left + x]
    for k in range(width):
        x = np.uintp(k)
        gy[place + x] = lines[down + x] - lines[up + x]


@inlined
def _sobel(lines: Floats, rows: Rows, width: int, gx: Floats, gy: Floats, to: int) -> None:
    """The same, smoothed by [1, 2, 1] along the other axis."""
    two, one_, two_ = gx.dtype.type(2), np.uintp(1), np.uintp(2)
    for k in range(width):
        x = np.uintp(k)
        a, b, c, place = np.uintp(rows.above) + x, np.uintp(rows.here) + x, np.uintp(rows.below) + x, np.uintp(to) + x
        # differences first, as in the reference, so that a flat area has a zero gradient
        gx[place] = (lines[a + two_] - lines[a]) + two * (lines[b + two_] - lines[b]) + (lines[c + two_] - lines[c])
        gy[place] = (
            (lines[c] - lines[a]) + two * (lines[c + one_] - lines[a + one_]) + (lines[c + two_] - lines[a + two_])
        )


@inlined
def _border(
    lines: Floats, rows: Rows, width: int, first: bool, last: bool, reading: Reading, gx: Floats, gy: Floats, to: int
) -> None:
    """Replaces central differences at the outermost pixels, which need a value from beyond the image."""
    factor, own, beyond, line = reading.border_factor, reading.border_is_own, reading.border_value, rows.here
    if width > 1:
        gx[to] = factor * (lines[line + 2] - (lines[line + 1] if own else beyond))
        gx[to + width - 1] = factor * ((lines[line + width] if own else beyond) - lines[line + width - 1])
    if first and not last:
        for x in range(width):
            gy[to + x] = factor * (lines[rows.below + x + 1] - (lines[line + x + 1] if own else beyond))
    elif last and not first:
        for x in range(width):
            gy[to + x] = factor * ((lines[line + x + 1] if own else beyond) - lines[rows.above + x + 1])


@inlined
def gradient_of_row(
    lines: Floats, pixels: Pixels, channel: int, row: int, reading: Reading, gx: Floats, gy: Floats, to: int
) -> None:
    """Gradients of one row of one channel, to ``gx[to:]`` and ``gy[to:]``."""
    height, width = pixels.height, pixels.width
    above, below = max(row - 1, 0), min(row + 1, height - 1)
    if row == 0:  # mirrored at the outermost row
        above = below
    elif row == height - 1:
        below = above
    begin, size = 3 * channel, width + 2
    rows = Rows((begin + above % 3) * size, (begin + row % 3) * size, (begin + below % 3) * size)
    if reading.sobel:
        _sobel(lines, rows, width, gx, gy, to)
    else:
        _central(lines, rows, width, gx, gy, to)
    if reading.border_factor > 0:
        _border(lines, rows, width, row == 0, row == height - 1, reading, gx, gy, to)


@inlined
def _choose(work: Gradients, channel: int, last_wins: Flags, width: int, to: int) -> None:
    """Replaces gradients by the channel's where its magnitude is larger; or equal, where the last channel wins."""
    number = np.int32(channel)
    gx, gy, winner, other_gx, other_gy = work.gx, work.gy, work.winner, work.other_gx, work.other_gy
    for k in range(width):
        x, place = np.uintp(k), np.uintp(to) + np.uintp(k)
        u, v, own_u, own_v = other_gx[x], other_gy[x], gx[place], gy[place]
        ours, theirs = own_u * own_u + own_v * own_v, u * u + v * v
        better = theirs > ours or (last_wins[x] and theirs == ours)
        gx[place] = u if better else own_u
        gy[place] = v if better else own_v
        winner[place] = number if better else winner[place]


@inlined
def gradients_of_rows(
    pixels: Pixels, start: int, reading: Reading, begin: int, end: int, last_read: int, work: Gradients, at: int
) -> int:
    """Eq. 1-2: gradients of rows ``begin`` to ``end`` of the image at ``start``, to the planes of ``work[at:]``.

    They are of the channel of largest magnitude.  ``last_read`` is the last row in the ring buffer, on return too.
    """
    width, stride = pixels.width, padded(pixels.width)
    last_read = max(last_read, begin - 2)
    for row in range(begin, end):
        while last_read < min(row + 1, pixels.height - 1):
            last_read += 1
            _read_row(pixels, start, last_read, reading, work.values, work.lines)
        to = at + (row - begin) * stride
        gradient_of_row(work.lines, pixels, 0, row, reading, work.gx, work.gy, to)
        if reading.channels > 1:
            work.winner[to : to + width] = 0
        for channel in range(1, reading.channels):
            gradient_of_row(work.lines, pixels, channel, row, reading, work.other_gx, work.other_gy, 0)
            _choose(work, channel, reading.last_wins, width, to)
    return last_read
