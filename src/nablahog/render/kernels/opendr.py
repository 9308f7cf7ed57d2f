""":mod:`..opendr` compiled: silhouettes drawn over the samples, then the image and its gradient."""

from __future__ import annotations

import numpy as np

from ...runtime.compile import borrowing
from .arrays import AT, DEPTH, MEASURED, SLOPE, Bytes, Crossings, Floats, Integers, Pixels, Samples


@borrowing
def draw_silhouettes(samples: Samples, silhouette: Bytes, crossings: Crossings, count: int) -> None:
    """Draws silhouette edges one sample wide, with brightness and 1 / depth of the surface in front.

    Args:
        samples: change on silhouettes.
        silhouette: (E,), of :func:`.silhouettes.silhouette_edges`.
        crossings, count: of :func:`.silhouettes.edge_crossings`.  Afterwards ``number[0]`` is above 0 on silhouettes;
            ``values`` are overwritten.
    """
    brightness, inverse = samples.brightness, samples.inverse
    values, link = crossings.values, crossings.link
    real = brightness.dtype.type
    half, zero = real(0.5), real(0)
    drawn = crossings.number[0]
    drawn[:] = 0
    for n in range(count):
        if values[n, MEASURED] == zero or not silhouette[crossings.edge[n]]:
            continue
        axis, i, j = link[n, 0], link[n, 1], link[n, 2]
        i2, j2 = i + 1 - axis, j + axis
        front = max(inverse[i, j], inverse[i2, j2])
        to_i, to_j = (i2, j2) if values[n, AT] >= half else (i, j)
        other = drawn[to_i, to_j] - 1
        # of several silhouettes through one sample the nearest is visible
        if other < 0 or front > values[other, DEPTH]:
            drawn[to_i, to_j] = n + 1
            # the slope is not needed any more: its column holds the brightness to draw
            values[n, SLOPE] = brightness[i2, j2] if inverse[i2, j2] > inverse[i, j] else brightness[i, j]
            values[n, DEPTH] = front
    for n in range(count):
        if values[n, MEASURED] == zero or not silhouette[crossings.edge[n]]:
            continue
        axis, i, j = link[n, 0], link[n, 1], link[n, 2]
        to_i, to_j = (i + 1 - axis, j + axis) if values[n, AT] >= half else (i, j)
        if drawn[to_i, to_j] == n + 1:
            brightness[to_i, to_j], inverse[to_i, to_j] = values[n, SLOPE], values[n, DEPTH]


@borrowing
def resolve(samples: Samples, drawn: Integers, pixels: Pixels) -> None:
    """Writes the mean of each pixel's samples, and its gradient by :func:`..opendr.image_gradient`.

    Args:
        samples: after :func:`draw_silhouettes`.
        drawn: (H, W), not 0 on silhouettes.
        pixels: as for :func:`.antialias.antialias`.
    """
    image, screen_gradient, corner, step = pixels
    brightness, inverse = samples.brightness, samples.inverse
    real = brightness.dtype.type
    side = real(1) / real(step)
    height, width = brightness.shape
    differentiated = screen_gradient.shape[0] > 0
    for row in range(height // step):
        y = np.uintp(corner[0] + row)
        for pixel in range(width // step):
            x = np.uintp(corner[1] + pixel)
            total = by_x = by_x_depth = by_y = by_y_depth = real(0)
            for i in range(row * step, row * step + step):
                for j in range(pixel * step, pixel * step + step):
                    total += brightness[i, j]
                    w = inverse[i, j]
                    if not differentiated or w <= 0:
                        continue
                    along_x = _difference(brightness[i], drawn[i], j)
                    along_y = _difference(brightness[:, j], drawn[:, j], i)
                    by_x -= along_x
                    by_x_depth -= along_x * w
                    by_y -= along_y
                    by_y_depth -= along_y * w
            image[y, x] = total * side * side
            if differentiated:
                screen_gradient[0, y, x], screen_gradient[1, y, x] = side * by_x, side * by_x_depth
                screen_gradient[2, y, x], screen_gradient[3, y, x] = side * by_y, side * by_y_depth


@borrowing
def _difference(line: Floats, drawn: Integers, k: int) -> float:
    """The derivative along a line of samples: the mean of the one-sided differences that touch no silhouette.

    If both do, twice the central difference.
    """
    here: float = line[k]
    before = after = here - here
    has_before = has_after = False
    free = drawn[k] == 0
    if k > 0:
        before = here - line[k - 1]
        has_before = free and drawn[k - 1] == 0
    if k + 1 < line.size:
        after = line[k + 1] - here
        has_after = free and drawn[k + 1] == 0
    if has_before and has_after:
        mean: float = (before + after) * line.dtype.type(0.5)
        return mean
    if has_before:
        return before
    if has_after:
        return after
    # the central difference is half of this sum, and counts twice
    return before + after
