"""Eq. 1-2 a line of pixels at a time: from stored values to gradients, and back.

A line holds the values of one row of pixels between two more, its ends, that mirror it at the outermost pixels.
"""

from __future__ import annotations

import math
from typing import Any

from ...compile import compiled
from ..gradient import BLACK


@compiled
def read_line(pixels: Any, scale: Any, weight: Any, first: bool, root: bool, line: Any) -> None:
    """Values of ``pixels`` (width,), times ``scale``, to ``line``, or added to it.

    ``weight`` is the channel's in Eq. 1; it applies to the roots if there are any.
    """
    width = line.size - 2
    real = line.dtype.type
    if root:
        black, zero = real(BLACK), real(0)
        for x in range(width):
            value = scale * real(pixels[x])
            value = weight * (zero if value <= black else math.sqrt(value))
            line[x + 1] = value if first else line[x + 1] + value
    elif first:
        for x in range(width):
            line[x + 1] = weight * (scale * real(pixels[x]))
    else:
        for x in range(width):
            line[x + 1] += weight * (scale * real(pixels[x]))
    line[0], line[width + 1] = line[min(2, width)], line[max(width - 1, 1)]


@compiled
def central(above: Any, line: Any, below: Any, gx: Any, gy: Any) -> None:
    """Eq. 2: the mask [-1, 0, 1] along either axis."""
    for x in range(gx.size):
        gx[x] = line[x + 2] - line[x]
        gy[x] = below[x + 1] - above[x + 1]


@compiled
def sobel(above: Any, line: Any, below: Any, gx: Any, gy: Any) -> None:
    """The same, smoothed by [1, 2, 1] along the other axis."""
    real = gx.dtype.type
    two = real(2)
    for x in range(gx.size):
        # as differences first, like the plain steps, so that a flat area has a zero gradient
        gx[x] = (above[x + 2] - above[x]) + two * (line[x + 2] - line[x]) + (below[x + 2] - below[x])
        gy[x] = (below[x] - above[x]) + two * (below[x + 1] - above[x + 1]) + (below[x + 2] - above[x + 2])


@compiled
def edges(
    above: Any, line: Any, below: Any, first: bool, last: bool, times: Any, own: bool, beyond: Any, gx: Any, gy: Any
) -> None:
    """Replaces central differences at the image's outermost pixels, which need a value from beyond it.

    That is the pixel's own if ``own``, else ``beyond``; the difference counts ``times``.
    """
    width = gx.size
    if width > 1:
        gx[0] = times * (line[2] - (line[1] if own else beyond))
        gx[width - 1] = times * ((line[width] if own else beyond) - line[width - 1])
    if first and not last:
        for x in range(width):
            gy[x] = times * (below[x + 1] - (line[x + 1] if own else beyond))
    elif last and not first:
        for x in range(width):
            gy[x] = times * ((line[x + 1] if own else beyond) - above[x + 1])


@compiled
def choose(us: Any, vs: Any, channel: int, last_wins: Any, gx: Any, gy: Any, winner: Any) -> None:
    """Replaces gradients by a further channel's where its magnitude is larger; or as large, where the last wins."""
    for x in range(gx.size):
        ours, theirs = gx[x] * gx[x] + gy[x] * gy[x], us[x] * us[x] + vs[x] * vs[x]
        better = theirs > ours or (last_wins[x] and theirs == ours)
        gx[x] = us[x] if better else gx[x]
        gy[x] = vs[x] if better else gy[x]
        winner[x] = channel if better else winner[x]
