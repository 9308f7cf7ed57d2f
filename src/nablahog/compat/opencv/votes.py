"""OpenCV's gradients and votes of an image of bytes, row by row, compiled.

The results are those of :mod:`nablahog.hog`, of which the general loops know neither windows in the middle of an image
nor a padding whose outermost pixels have gradients.  Here tables say which pixel stands in a row and in a column.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...hog import HOGSpec
from ...hog.library_angles import opencv_table
from ...runtime.arrays import Bytes, Floats, Integers
from ...runtime.compile import compiled, inlined


class Region(NamedTuple):
    """Pixels to describe: a part of a padded image."""

    values: Bytes  # the image, its axes (rows, columns, channels) in one line
    channels: int
    row_of: Integers  # (rows + 2,): where a row of the region begins in values; one more before and behind
    pixel_of: Integers  # (columns + 2,): the same of columns
    tail: int  # the first column where the last of several channels of equal magnitude counts, not the first


class Angles(NamedTuple):
    """What votes need to know of a dialect."""

    values: Floats  # (256,): what a byte stands for
    polynomial: Floats  # (7,): see library_angles
    offset: np.float32  # in bins
    bins: np.float32


class Row(NamedTuple):
    """Votes of a row of pixels: ``near`` for the bin ``bins``, ``far`` for the next one; and space to work."""

    near: Floats
    far: Floats
    bins: Integers  # int32
    lines: Floats  # for each channel the last three rows as floating point; row y at y % 3
    gx: Floats
    gy: Floats


def angles(spec: HOGSpec) -> Angles:
    """Of a dialect of :func:`nablahog.presets.opencv`."""
    values = np.arange(256, dtype=np.float32)
    return Angles(
        np.sqrt(values) if spec.gamma == "sqrt" else values,
        np.array(opencv_table(spec), np.float32),
        np.float32(spec.bin_offset),
        np.float32(spec.bins),
    )


@compiled
def new_row(width: int, channels: int) -> Row:
    """Space for a row of that many pixels."""
    near, far, bins = np.zeros(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.int32)
    lines = np.zeros(channels * 3 * (width + 2), np.float32)
    return Row(near, far, bins, lines, np.zeros(width, np.float32), np.zeros(width, np.float32))


@inlined
def read_row(region: Region, y: int, table: Floats, row: Row) -> None:
    """Reads a row, -1 to rows, to the ring of lines."""
    size = region.pixel_of.size
    begin, slot = region.row_of[y + 1], (y + 1) % 3
    for channel in range(region.channels):
        first, to = begin + channel, (channel * 3 + slot) * size
        for k in range(size):
            at = np.uintp(first + region.pixel_of[np.uintp(k)])
            row.lines[np.uintp(to) + np.uintp(k)] = table[np.uintp(region.values[at])]


@inlined
def _gradients(region: Region, y: int, row: Row) -> None:
    """Differences, of the channel of largest magnitude."""
    size, lines, gx, gy = region.pixel_of.size, row.lines, row.gx, row.gy
    one, two = np.uintp(1), np.uintp(2)
    for channel in range(region.channels):
        first = channel * 3
        above, here, below = (first + y % 3) * size, (first + (y + 1) % 3) * size, (first + (y + 2) % 3) * size
        for k in range(gx.size):
            x = np.uintp(k)
            u = lines[np.uintp(here) + x + two] - lines[np.uintp(here) + x]
            v = lines[np.uintp(below) + x + one] - lines[np.uintp(above) + x + one]
            if channel == 0:
                gx[x], gy[x] = u, v
            else:
                ours, theirs = gx[x] * gx[x] + gy[x] * gy[x], u * u + v * v
                better = theirs > ours or (theirs == ours and k >= region.tail)
                gx[x] = u if better else gx[x]
                gy[x] = v if better else gy[x]


@inlined
def votes_of_row(region: Region, y: int, angles: Angles, row: Row) -> None:
    """Votes of row ``y``, of which the rows before, y and behind are in the ring of lines."""
    _gradients(region, y, row)
    p1, p3, p5, p7 = angles.polynomial[0], angles.polynomial[1], angles.polynomial[2], angles.polynomial[3]
    guard, radian, per_radian = angles.polynomial[4], angles.polynomial[5], angles.polynomial[6]
    right, straight, full, zero, one = np.float32(90), np.float32(180), np.float32(360), np.float32(0), np.float32(1)
    for k in range(row.near.size):
        x = np.uintp(k)
        u, v = row.gx[x], row.gy[x]
        m = math.sqrt(u * u + v * v)
        au, av = abs(u), abs(v)
        steep = au < av
        small, large = (au, av) if steep else (av, au)
        t = small / (large + guard)
        s = t * t
        angle = (((p7 * s + p5) * s + p3) * s + p1) * t
        angle = right - angle if steep else angle
        angle = straight - angle if u < zero else angle
        angle = full - angle if v < zero else angle
        position = angle * radian * per_radian - angles.offset
        before = np.floor(position)
        f = position - before
        before = before + angles.bins if before < zero else before
        before = before - angles.bins if before >= angles.bins else before
        row.near[x], row.far[x], row.bins[x] = m * (one - f), m * f, np.int32(before)


@compiled
def votes_of_region(region: Region, angles: Angles, near: Floats, far: Floats, bins: Integers) -> None:
    """Votes of all pixels, (rows, columns) each."""
    rows, width = near.shape
    row = new_row(width, region.channels)
    read_row(region, -1, angles.values, row)
    read_row(region, 0, angles.values, row)
    for y in range(rows):
        read_row(region, y + 1, angles.values, row)
        votes_of_row(region, y, angles, row)
        near[y], far[y], bins[y] = row.near, row.far, row.bins
