"""Eq. 1-2 a line of pixels at a time: from stored values to gradients, and back.

A line holds the values of one row of pixels between two more, its ends, that mirror it at the outermost pixels.  Lines
and what is made of them are parts of longer arrays, told apart by where they begin.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...runtime.compile import inlined
from ..gradient import BLACK


@inlined
def read_line(
    pixels: Any,
    begin: int,
    step: int,
    width: int,
    scale: Any,
    weight: Any,
    first: bool,
    root: bool,
    lines: Any,
    to: int,
) -> None:
    """Values of a row of pixels, times ``scale``, to the line at ``lines[to:]``, or added to it.

    ``weight`` is the channel's in Eq. 1; it applies to the roots if there are any.
    """
    real, black = lines.dtype.type, lines.dtype.type(BLACK)
    zero = real(0)
    at, apart, place = np.uintp(begin), np.uintp(step), np.uintp(to + 1)
    for k in range(width):
        x = np.uintp(k)
        value = scale * real(pixels[at + x * apart])
        if root:
            value = zero if value <= black else math.sqrt(value)
        value = weight * value
        lines[place + x] = value if first else lines[place + x] + value
    lines[to], lines[to + width + 1] = lines[to + min(2, width)], lines[to + max(width - 1, 1)]


@inlined
def central(lines: Any, above: int, line: int, below: int, width: int, gx: Any, gy: Any, to: int) -> None:
    """Eq. 2: the mask [-1, 0, 1] along either axis, of the lines that begin there."""
    left, up, down, place = np.uintp(line), np.uintp(above + 1), np.uintp(below + 1), np.uintp(to)
    right = np.uintp(line + 2)
    for k in range(width):
        x = np.uintp(k)
        gx[place + x] = lines[right + x] - lines[left + x]
    for k in range(width):
        x = np.uintp(k)
        gy[place + x] = lines[down + x] - lines[up + x]


@inlined
def sobel(lines: Any, above: int, line: int, below: int, width: int, gx: Any, gy: Any, to: int) -> None:
    """The same, smoothed by [1, 2, 1] along the other axis."""
    two, one_, two_ = gx.dtype.type(2), np.uintp(1), np.uintp(2)
    for k in range(width):
        x = np.uintp(k)
        a, b, c, place = np.uintp(above) + x, np.uintp(line) + x, np.uintp(below) + x, np.uintp(to) + x
        # as differences first, like the plain steps, so that a flat area has a zero gradient
        gx[place] = (lines[a + two_] - lines[a]) + two * (lines[b + two_] - lines[b]) + (lines[c + two_] - lines[c])
        gy[place] = (
            (lines[c] - lines[a]) + two * (lines[c + one_] - lines[a + one_]) + (lines[c + two_] - lines[a + two_])
        )


@inlined
def edges(
    lines: Any,
    above: int,
    line: int,
    below: int,
    width: int,
    first: bool,
    last: bool,
    times: Any,
    own: bool,
    beyond: Any,
    gx: Any,
    gy: Any,
    to: int,
) -> None:
    """Replaces central differences at the image's outermost pixels, which need a value from beyond it.

    That is the pixel's own if ``own``, else ``beyond``; the difference counts ``times``.
    """
    if width > 1:
        gx[to] = times * (lines[line + 2] - (lines[line + 1] if own else beyond))
        gx[to + width - 1] = times * ((lines[line + width] if own else beyond) - lines[line + width - 1])
    if first and not last:
        for x in range(width):
            gy[to + x] = times * (lines[below + x + 1] - (lines[line + x + 1] if own else beyond))
    elif last and not first:
        for x in range(width):
            gy[to + x] = times * ((lines[line + x + 1] if own else beyond) - lines[above + x + 1])


@inlined
def choose(
    us: Any, vs: Any, channel: int, last_wins: Any, width: int, gx: Any, gy: Any, to: int, winner: Any, row: int
) -> None:
    """Replaces gradients by a further channel's where its magnitude is larger; or as large, where the last wins.

    Those are at ``gx[to:]`` and ``gy[to:]``, which channel they are of at ``winner[row:]``.
    """
    number = np.int32(channel)
    for k in range(width):
        x, place, at = np.uintp(k), np.uintp(to) + np.uintp(k), np.uintp(row) + np.uintp(k)
        u, v, own_u, own_v = us[x], vs[x], gx[place], gy[place]
        ours, theirs = own_u * own_u + own_v * own_v, u * u + v * v
        better = theirs > ours or (last_wins[x] and theirs == ours)
        gx[place] = u if better else own_u
        gy[place] = v if better else own_v
        winner[at] = number if better else winner[at]
