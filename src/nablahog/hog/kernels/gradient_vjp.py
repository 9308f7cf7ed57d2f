"""The vjp of Eq. 1-4: from gradients of votes to gradients of Gx and Gy, and row by row on to pixels.

Numba vectorises these loops: vector instructions gained 1.01 (votes) and 1.05 (central differences) in hog's vjp
(AMD EPYC, AVX2, float32, one image of 256 x 256, `paper`), and were removed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Integers, Real
from ...runtime.compile import borrowing, inlined
from ...runtime.simd import PADDING, aligned_zeros, whole_vectors
from ..gradient import BLACK
from .gradient_loops import padded, stored_values
from .parameters import Pixels, Reading
from .pooling_vjp import VoteGradients
from .votes import Votes


class Ring(NamedTuple):
    """Workspace: a ring buffer of three rows, each between two zeros, ``ring_line(width)`` apart."""

    gx: Floats  # gradients of Gx
    gy: Floats
    winner: Integers  # the channel they are of
    channel_gx: Floats  # the same of one channel, if there are several
    channel_gy: Floats
    values: Floats  # (width,): gradients of one row of values
    stored: Floats  # (width,): the row as it is stored


@inlined
def ring_line(width: int) -> int:
    """Elements from row to row of a ring buffer."""
    size: int = padded(width) + PADDING
    return size


def new_ring(reading: Reading, width: int, dtype: DType) -> Ring:
    size = 3 * (whole_vectors(width) + PADDING)
    several = size if reading.channels > 1 else 0
    gx, gy, winner = aligned_zeros(size, dtype), aligned_zeros(size, dtype), aligned_zeros(size, np.int32)
    return Ring(gx, gy, winner, *(aligned_zeros(n, dtype) for n in (several, several, width, width)))


class PlaneGradients(NamedTuple):
    """Planes of gradients of Gx and Gy."""

    gx: Floats
    gy: Floats


def new_plane_gradients(size: int, dtype: DType) -> PlaneGradients:
    return PlaneGradients(aligned_zeros(size, dtype), aligned_zeros(size, dtype))


@borrowing
def votes_vjp(
    votes: Votes,
    gradients: VoteGradients,
    exact: Votes,
    exact_gradients: VoteGradients,
    gx: Floats,
    gy: Floats,
    slope: Real,
    out: PlaneGradients,
) -> None:
    """Gradients of Gx and Gy from those of votes, of the planes ``gx`` and ``gy``.

    The magnitude changes the votes for both bins, the angle moves votes between them: on a bin centre, by the mean of
    both sides.  ``exact`` are votes by the exact angle; ``slope`` is in bins per radian.
    """
    zero, half, one = gx.dtype.type(0), gx.dtype.type(0.5), gx.dtype.type(1)
    m, f, here, after, centre = votes.m, votes.f, gradients.here, gradients.after, exact.f
    left, own, right = exact_gradients.before, exact_gradients.here, exact_gradients.after
    out_x, out_y = out.gx, out.gy
    for k in range(gx.size):
        x = np.uintp(k)
        some = m[x] > zero
        inverse = one / m[x] if some else zero
        along = (here[x] + f[x] * (after[x] - here[x])) * inverse if some else zero
        change = (right[x] - left[x]) * half if centre[x] == zero else right[x] - own[x]
        across = slope * change * inverse if some else zero
        out_x[x] = along * gx[x] - across * gy[x]
        out_y[x] = along * gy[x] + across * gx[x]


@borrowing
def hard_votes_vjp(votes: Votes, gradients: VoteGradients, gx: Floats, gy: Floats, out: PlaneGradients) -> None:
    """The same of hard votes, which do not change with the angle."""
    zero, one = gx.dtype.type(0), gx.dtype.type(1)
    m, here, out_x, out_y = votes.m, gradients.here, out.gx, out.gy
    for k in range(gx.size):
        x = np.uintp(k)
        along = here[x] * (one / m[x]) if m[x] > zero else zero
        out_x[x], out_y[x] = along * gx[x], along * gy[x]


@inlined
def border_vjp(gx: Floats, gy: Floats, to: int, width: int, row: int, height: int, factor: Real) -> None:
    """Of a row of the ring buffer: outermost pixels count ``factor``, and not at all along an axis of one pixel."""
    gx[to + 1] *= factor
    if width > 1:
        gx[to + width] *= factor
    else:
        gx[to + 1] = 0
    if row == 0 or row == height - 1:
        for x in range(width):
            gy[to + x + 1] *= factor if height > 1 else 0


@inlined
def _of_channel(plane: Floats, winner: Integers, channel: int, out: Floats) -> None:
    """The three rows, zero where another channel won."""
    for k in range(out.size):
        x = np.uintp(k)
        out[x] = plane[x] if winner[x] == channel else 0


@inlined
def _central_vjp(
    gx: Floats, gy: Floats, row: int, height: int, width: int, reading: Reading, slope: Real, out: Floats, to: int
) -> None:
    """``slope`` times the gradients of a row of values, from the rows of Gx and Gy above, here and below."""
    size = ring_line(width)
    line, above, below = row % 3 * size, (row + 2) % 3 * size, (row + 1) % 3 * size
    left, right = np.uintp(line), np.uintp(line + 2)
    up, down, place = np.uintp(above + 1), np.uintp(below + 1), np.uintp(to)
    for k in range(width):
        x = np.uintp(k)
        out[place + x] = slope * (gx[left + x] - gx[right + x] + gy[up + x] - gy[down + x])
    if reading.border_factor > 0 and reading.border_is_own:  # the value beyond the image is the outermost pixel's own
        out[to] -= slope * gx[line + 1]
        out[to + width - 1] += slope * gx[line + width]
        if row == 0:
            for x in range(width):
                out[to + x] -= slope * gy[line + x + 1]
        if row == height - 1:
            for x in range(width):
                out[to + x] += slope * gy[line + x + 1]


@inlined
def _sobel_vjp(gx: Floats, gy: Floats, row: int, height: int, width: int, out: Floats) -> None:
    """The same for smoothed gradients of a mirrored image: the outermost rows and columns have one neighbour twice."""
    size, two = ring_line(width), out.dtype.type(2)
    line, above, below = row % 3 * size, (row + 2) % 3 * size, (row + 1) % 3 * size
    of_above, of_below = two if row == 1 else two - 1, two if row == height - 2 else two - 1
    own = two + two if height == 1 else two
    for x in range(width):
        out[x] = own * (gx[line + x] - gx[line + x + 2])
        out[x] += of_above * (gx[above + x] - gx[above + x + 2])
        out[x] += of_below * (gx[below + x] - gx[below + x + 2])
        before = gy[above + x] - gy[below + x]
        here = gy[above + x + 1] - gy[below + x + 1]
        after = gy[above + x + 2] - gy[below + x + 2]
        out[x] += before + two * here + after
    first, last = gy[above + 1] - gy[below + 1], gy[above + width] - gy[below + width]
    if width == 1:
        out[0] += two * first
    else:
        out[1] += first
        out[width - 2] += last


@inlined
def _reading_vjp(pixels: Pixels, begin: int, reading: Reading, channel: int, ring: Ring, out: Floats, to: int) -> None:
    """From gradients of values to those of the pixels at ``begin``, by the derivative of the root if there is one."""
    real, black = out.dtype.type, out.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    place, slope = np.uintp(to), reading.weights[channel] * reading.scale
    values, stored, scale, width = ring.values, ring.stored, reading.scale, pixels.width
    if reading.sqrt:
        stored_values(pixels, begin, stored)
        for x in range(width):
            value = scale * stored[x]
            out[to + x] = zero if value <= black else slope * half / math.sqrt(value) * values[x]
    else:
        for k in range(width):
            x = np.uintp(k)
            out[place + x] = slope * values[x]


@inlined
def row_vjp(pixels: Pixels, start: int, row: int, reading: Reading, ring: Ring, out: Floats) -> None:
    """Gradients of one row of all channels, to ``out`` (channels · height · width), from those of three rows."""
    height, width = pixels.height, pixels.width
    several = ring.channel_gx.size > 0
    for channel in range(reading.weights.size):
        if several:
            _of_channel(ring.gx, ring.winner, channel, ring.channel_gx)
            _of_channel(ring.gy, ring.winner, channel, ring.channel_gy)
        gx, gy = (ring.channel_gx, ring.channel_gy) if several else (ring.gx, ring.gy)
        to = (channel * height + row) * width
        if not (reading.sobel or reading.sqrt or reading.averaged):
            slope = reading.weights[channel] * reading.scale
            _central_vjp(gx, gy, row, height, width, reading, slope, out, to)
            continue
        if channel == 0 or not reading.averaged:
            if reading.sobel:
                _sobel_vjp(gx, gy, row, height, width, ring.values)
            else:
                _central_vjp(gx, gy, row, height, width, reading, reading.scale / reading.scale, ring.values, 0)
        begin = start + channel * pixels.strides[1] + row * pixels.strides[2]
        _reading_vjp(pixels, begin, reading, channel, ring, out, to)
