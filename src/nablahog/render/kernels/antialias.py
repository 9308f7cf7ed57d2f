"""Samples to pixels, with anti-aliased edges, and the derivative of pixels by the motion of surfaces."""

from __future__ import annotations

import numpy as np

from ...runtime.compile import borrowing, compiled, inlined
from .arrays import AT, DEPTH, MEASURED, SLOPE, Crossings, Floats, Pixels, Samples


@compiled
def antialias(samples: Samples, crossings: Crossings, count: int, pixels: Pixels) -> None:
    """Writes the mean of each pixel's samples, with each visible edge where it crosses between samples.

    Args:
        samples: of the box, shaded.
        crossings, count: of :func:`.silhouettes.edge_crossings`.
        pixels: get brightness and screen gradient inside the box.
    """
    image, screen_gradient, corner, step = pixels
    real = samples.brightness.dtype.type
    half, side = real(0.5), real(1) / real(step)
    share = side * side
    differentiated = screen_gradient.shape[0] > 0
    height, width = samples.brightness.shape
    # for this row of pixels and the next, sample by sample: brightness, and the four channels of the gradient
    sums = np.zeros((2, 5, width), samples.brightness.dtype)
    links = np.zeros((2, width), samples.brightness.dtype)
    for row in range(height // step):
        for i in range(row * step, row * step + step):
            here = np.uintp(i)
            for j in range(width):
                sums[0, 0, np.uintp(j)] += samples.brightness[here, np.uintp(j)]
            if differentiated:
                for axis in range(2):
                    if axis == 1 or i + 1 < height:
                        next_row = (i + 1 - axis) // step - row
                        _add_link_gradients(samples, crossings.number, i, axis, next_row, links, sums)
        y, left, right = corner[0] + row, corner[1], corner[1] + width // step
        _pool(sums[0, 0], step, share, image[y, left:right])
        for channel in range(screen_gradient.shape[0]):
            _pool(sums[0, 1 + channel], step, half * side, screen_gradient[channel, y, left:right])
        _move_up(sums)
    _add_crossings(samples.brightness, crossings, count, pixels)


@inlined
def _add_link_gradients(
    samples: Samples, number: Floats, i: int, axis: int, next_row: int, links: Floats, sums: Floats
) -> None:
    """Adds the gradient of links without an edge, from the samples of row ``i`` along one axis.

    Where brightness changes without an edge, the boundary is half-way between two samples, and both of them change.
    Each step is a loop of its own, since the compiler turns only short loops into vector instructions.

    Args:
        number: of :class:`.arrays.Crossings`.
        next_row: 1 if the link's other sample is in the next row of pixels, else 0.
        links: (2, W), scratch: differences of brightness, and the same times 1 / depth.
        sums: (2, 5, W).
    """
    real = links.dtype.type
    zero, half = real(0), real(0.5)
    ids, inverse, brightness = samples.ids, samples.inverse, samples.brightness
    width = brightness.shape[1]
    here, there, shift = np.uintp(i), np.uintp(i + 1 - axis), np.uintp(axis)
    for first in range(width - axis):
        j = np.uintp(first)
        d = brightness[there, j + shift] - brightness[here, j]
        links[0, j] = d if number[axis, here, j] == 0 else zero
    for first in range(width - axis):
        j = np.uintp(first)
        w, w2 = inverse[here, j], inverse[there, j + shift]
        w = half * (w + w2) if ids[here, j] == ids[there, j + shift] else max(w, w2)
        d = links[0, j]
        links[0, j] = d if w > 0 else zero
        links[1, j] = d * w
    other = np.uintp(next_row)
    for k in range(2):
        channel = np.uintp(3 - 2 * axis + k)
        for j in range(width - axis):
            sums[0, channel, np.uintp(j)] -= links[np.uintp(k), np.uintp(j)]
        for j in range(width - axis):
            sums[other, channel, np.uintp(j) + shift] -= links[np.uintp(k), np.uintp(j)]


@inlined
def _move_up(sums: Floats) -> None:
    """The sums of the next row become those of this one.

    In loops: numba compiles string functions, for three seconds, for the error message of an assignment.
    """
    for channel in range(sums.shape[1]):
        for j in range(sums.shape[2]):
            sums[0, channel, j], sums[1, channel, j] = sums[1, channel, j], 0


@inlined
def _add_crossings(brightness: Floats, crossings: Crossings, count: int, pixels: Pixels) -> None:
    """Moves the boundary of links with an edge to where the edge crosses, and adds its gradient."""
    image, screen_gradient, corner, step = pixels
    real = brightness.dtype.type
    half, side = real(0.5), real(1) / real(step)
    share = side * side
    values, link = crossings.values, crossings.link
    for n in range(count):
        if values[n, MEASURED] == 0:  # counted on the links of the other axis
            continue
        axis, i, j = link[n, 0], link[n, 1], link[n, 2]
        i2, j2 = i + 1 - axis, j + axis
        d = brightness[i2, j2] - brightness[i, j]
        t = values[n, AT]
        y, x = (i // step, j // step) if t < half else (i2 // step, j2 // step)
        y, x = corner[0] + y, corner[1] + x
        image[y, x] += (half - t) * d * share
        if screen_gradient.shape[0] > 0:
            slope, w = values[n, SLOPE], values[n, DEPTH]
            k = 2 - 2 * axis
            d *= side
            screen_gradient[k, y, x] -= d
            screen_gradient[k + 1, y, x] -= d * w
            d *= slope
            screen_gradient[2 - k, y, x] += d
            screen_gradient[3 - k, y, x] += d * w


@borrowing
def _pool(line: Floats, step: int, factor: float, out: Floats) -> None:
    """Sums ``step`` neighbours each on a line, times ``factor``."""
    if step == 1:  # a loop of its own, which the compiler can turn into vector instructions
        for x in range(out.size):
            out[x] = factor * line[x]
        return
    for x in range(out.size):
        total = factor - factor
        for k in range(x * step, x * step + step):
            total += line[np.uintp(k)]
        out[x] = factor * total
