"""Eq. 1-6 and how they change with the image, in one pass: the derivative in forward mode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compile import compiled
from ..gradient import BLACK
from .cells import PIXELS_AT_ONCE, add_bands, collect, empty_groups, gradient_of_line, gradients_of_rows, place, share
from .lanes import add_four
from .votes import linear, vote_line


@compiled
def _read_changes(pixels: Any, at: int, strides: Any, changes: Any, row: int, reading: Any, lines: Any) -> None:
    """One row of ``changes`` (channels, height, width) of the pixels, to lines of changes of values."""
    width = lines.shape[2] - 2
    real, black = lines.dtype.type, lines.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    for channel in range(reading.weights.size):
        line = lines[0 if reading.mixed else channel, row % 3]
        begin = at + channel * strides[1] + row * strides[2]
        first = channel == 0 or not reading.mixed
        for x in range(width):
            slope = reading.weights[channel] * reading.scale
            if reading.root:
                value = reading.scale * real(pixels[begin + x * strides[3]])
                slope = zero if value <= black else slope * half / math.sqrt(value)
            change = slope * changes[channel, row, x]
            line[x + 1] = change if first else line[x + 1] + change
        line[0], line[width + 1] = line[min(2, width)], line[max(width - 1, 1)]


@compiled
def _chosen(us: Any, vs: Any, channel: int, winner: Any, dx: Any, dy: Any) -> None:
    """Replaces changes of gradients by the channel's where it won."""
    for x in range(dx.size):
        dx[x] = us[x] if winner[x] == channel else dx[x]
        dy[x] = vs[x] if winner[x] == channel else dy[x]


@compiled
def _changes_of_votes(
    gx: Any, gy: Any, dx: Any, dy: Any, m: Any, f: Any, exact: Any, hard: bool, slope: Any, changes: Any, turns: Any
) -> None:
    """How the votes change: ``changes`` (2, width) by the magnitude, of a bin and the next; ``turns`` (3, width) by the
    angle, of the bin before, the exact angle's bin and the next.

    On a bin centre the mean of both sides.
    """
    one, half = m.dtype.type(1), m.dtype.type(0.5)
    zero = one - one
    for x in range(m.size):
        inverse = one / m[x] if m[x] > zero else zero
        longer = (gx[x] * dx[x] + gy[x] * dy[x]) * inverse
        turned = slope * (gx[x] * dy[x] - gy[x] * dx[x]) * inverse
        far = zero if hard else longer * f[x]
        changes[0, x], changes[1, x] = longer - far, far
        centre = exact[x] == zero
        turns[0, x] = -half * turned if centre else zero
        turns[1, x] = zero if centre else -turned
        turns[2, x] = half * turned if centre else turned


@compiled
def _add(
    changes: Any,
    places: Any,
    turns: Any,
    exact_places: Any,
    row: int,
    part: int,
    hard: bool,
    pooling: Any,
    groups: Any,
) -> None:
    """Adds changes of votes of a part of a line to its groups."""
    by_row, by_col, size = pooling.by_row, pooling.by_col, pooling.group
    weight = np.uintp(4 * row)
    zero = changes.dtype.type(0)
    for k in range(pooling.parts[part, 0], pooling.parts[part, 1]):
        x = np.uintp(pooling.order[k])
        at, exact_at, col = np.uintp(places[x] - 4), np.uintp(exact_places[x] - 4), x * np.uintp(4 * pooling.groups)
        near, far = changes[0, x], changes[1, x]
        for _ in range(pooling.groups):
            add_four(groups, at, zero, near, far, zero, by_row, weight, by_col, col)
            if not hard:
                before, here, after = turns[0, x], turns[1, x], turns[2, x]
                add_four(groups, exact_at, before, here, after, zero, by_row, weight, by_col, col)
            at, exact_at, col = at + np.uintp(size), exact_at + np.uintp(size), col + np.uintp(4)


@compiled
def cells_tangent(
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
    """How cells of bands ``start`` to ``stop`` of one image change, to ``found`` (bands, rows, columns, bins).

    ``changes`` (channels, height, width) are the pixels'; ``beyond`` is ``reading`` of an image that has nothing there.
    """
    height, width = shape
    real = found.dtype
    described = 1 if reading.mixed else reading.weights.size
    at_once = max(1, PIXELS_AT_ONCE // width)
    lines, moved = np.empty((described, 3, width + 2), real), np.empty((described, 3, width + 2), real)
    planes = np.empty((6, at_once * width), real)
    dx, dy, exact = np.empty(width, real), np.empty(width, real), np.empty(width, real)
    by_size, by_turn = np.empty((2, width), real), np.empty((3, width), real)
    places, winner = np.empty(at_once * width, np.int32), np.zeros((at_once, width), np.int32)
    exact_places = np.empty(width, np.int32)
    groups, of_line = empty_groups(pooling, planes)
    read, moved_read = -1, -1
    for band in range(start, stop):
        first, last, _ = pooling.bands[band]
        for begin in range(first, last, at_once):
            end = min(begin + at_once, last)
            read = gradients_of_rows(pixels, at, shape, strides, reading, begin, end, read, lines, planes, winner)
            size = (end - begin) * width
            gx, gy, m, f = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size]
            vote_line(gx, gy, voting, planes[4, :size], planes[5, :size], m, f, places[:size])
            moved_read = max(moved_read, begin - 2)
            for row in range(begin, end):
                while moved_read < min(row + 1, height - 1):
                    moved_read += 1
                    _read_changes(pixels, at, strides, changes, moved_read, reading, moved)
                line = slice((row - begin) * width, (row - begin + 1) * width)
                us, vs = planes[4, line], planes[5, line]
                gradient_of_line(moved[0], row, height, beyond, dx, dy)
                for channel in range(1, described):
                    gradient_of_line(moved[channel], row, height, beyond, us, vs)
                    _chosen(us, vs, channel, winner[row - begin], dx, dy)
                of_pixels = places[line]
                place(of_pixels, 1, pooling.base)
                if voting.inexact:
                    linear(gx[line], gy[line], voting, exact, exact_places)
                    place(exact_places, 1, pooling.base)
                else:
                    exact[:] = f[line]
                    exact_places[:] = of_pixels
                _changes_of_votes(
                    gx[line], gy[line], dx, dy, m[line], f[line], exact, voting.hard, voting.slope, by_size, by_turn
                )
                for part in range(pooling.parts.shape[0]):
                    if pooling.lines:
                        _add(by_size, of_pixels, by_turn, exact_places, row, part, voting.hard, pooling, of_line)
                        share(of_line, row, part, pooling, groups)
                    else:
                        _add(by_size, of_pixels, by_turn, exact_places, row, part, voting.hard, pooling, groups)
        collect(groups, pooling, found[band])


@compiled
def tangents_of_images(
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
    of_bands = np.empty((bands, pooling.high, pooling.cols + pooling.wide, pooling.bins), found.dtype)
    for image in range(start, stop):
        begin = at + image * strides[0]
        cells_tangent(
            pixels, begin, shape, strides, changes[image], reading, beyond, voting, pooling, 0, bands, of_bands
        )
        add_bands(of_bands, pooling, found[image])
