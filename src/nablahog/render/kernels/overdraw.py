""":mod:`..opendr` compiled: outlines drawn over the samples, and from these the image with its motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...runtime.compile import compiled


@compiled
def overdraw(
    samples: Any, inverse: Any, outline: Any, slots: Any, places: Any, crossings: Any, followed: Any, count: int
) -> None:
    """Draws outlines one sample wide, with the surface in front at the crossing, and its 1 / depth.

    Args:
        samples, inverse: (H, W), change on outlines.
        outline, slots, places, crossings, followed, count: of :func:`.picture.outlines` and
            :func:`.picture.visible_edges`; ``slots[0]`` is more than 0 on outlines afterwards, ``crossings`` are used
            up.
    """
    number = samples.dtype.type
    half, zero = number(0.5), number(0)
    on_outline = slots[0]
    on_outline[:] = 0
    for h in range(count):
        if crossings[h, 3] == zero or not outline[followed[h]]:
            continue
        axis, i, j = places[h, 0], places[h, 1], places[h, 2]
        i2, j2 = i + 1 - axis, j + axis
        front = max(inverse[i, j], inverse[i2, j2])
        to_i, to_j = (i2, j2) if crossings[h, 0] >= half else (i, j)
        before = on_outline[to_i, to_j] - 1
        # of several outlines through one sample the nearest is seen
        if before < 0 or front > crossings[before, 2]:
            on_outline[to_i, to_j] = h + 1
            crossings[h, 1] = samples[i2, j2] if inverse[i2, j2] > inverse[i, j] else samples[i, j]
            crossings[h, 2] = front
    for h in range(count):
        if crossings[h, 3] == zero or not outline[followed[h]]:
            continue
        axis, i, j = places[h, 0], places[h, 1], places[h, 2]
        to_i, to_j = (i + 1 - axis, j + axis) if crossings[h, 0] >= half else (i, j)
        if on_outline[to_i, to_j] == h + 1:
            samples[to_i, to_j], inverse[to_i, to_j] = crossings[h, 1], crossings[h, 2]


@compiled
def pool(samples: Any, inverse: Any, on_outline: Any, corner: Any, step: int, image: Any, motion: Any) -> None:
    """Samples to pixels: their mean, and how it changes as :func:`..opendr.differences` has it.

    Args:
        samples, inverse, on_outline: (H, W), after :func:`overdraw`.
        corner, step, image, motion: as for :func:`.picture.blend`.
    """
    number = samples.dtype.type
    side = number(1) / number(step)
    height, width = samples.shape
    moves = motion.shape[0] > 0
    for row in range(height // step):
        y = np.uintp(corner[0] + row)
        for pixel in range(width // step):
            x = np.uintp(corner[1] + pixel)
            total = first_x = second_x = first_y = second_y = number(0)
            for i in range(row * step, row * step + step):
                for j in range(pixel * step, pixel * step + step):
                    total += samples[i, j]
                    w = inverse[i, j]
                    if not moves or w <= 0:
                        continue
                    along_x = _slope(samples[i], on_outline[i], j)
                    along_y = _slope(samples[:, j], on_outline[:, j], i)
                    first_x -= along_x
                    second_x -= along_x * w
                    first_y -= along_y
                    second_y -= along_y * w
            image[y, x] = total * side * side
            if moves:
                motion[0, y, x], motion[1, y, x] = side * first_x, side * second_x
                motion[2, y, x], motion[3, y, x] = side * first_y, side * second_y


@compiled
def _slope(line: Any, on_outline: Any, k: int) -> Any:
    """Along a line of samples: the mean of the differences that touch no outline, else twice the central one."""
    here = line[k]
    before = after = here - here
    has_before = has_after = False
    free = on_outline[k] == 0
    if k > 0:
        before = here - line[k - 1]
        has_before = free and on_outline[k - 1] == 0
    if k + 1 < line.size:
        after = line[k + 1] - here
        has_after = free and on_outline[k + 1] == 0
    if has_before and has_after:
        return (before + after) * line.dtype.type(0.5)
    if has_before:
        return before
    if has_after:
        return after
    # a central difference is half the sum of both steps, and counts twice
    return before + after
