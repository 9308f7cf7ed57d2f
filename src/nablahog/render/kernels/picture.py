"""Brightness of samples, visible edges between them, and from both the image with its motion.

All arrays of samples are those of a box of the image, whose first pixel is ``corner``: row and column.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...runtime.compile import compiled


@compiled
def shade(
    screen: Any,
    faces: Any,
    brightness: Any,
    ids: Any,
    inverse: Any,
    background: Any,
    corner: Any,
    step: int,
    planes: Any,
    samples: Any,
) -> None:
    """The brightness of each sample: perspective-correct between the corners of its triangle.

    Args:
        brightness: (F, 3), at the corners of each face.
        background: (H, W), a value for each pixel of the image.
        step: samples of a pixel, along a side.
        planes: (F, 7), scratch.
        samples: gets the brightness.
        others: as for :func:`.visibility.visibility`.
    """
    number = screen.dtype.type
    half = number(0.5)
    known = np.zeros(faces.shape[0], np.uint8)
    for i in range(samples.shape[0]):
        row = np.uintp(i)
        for pixel in range(samples.shape[1] // step):
            behind = background[corner[0] + i // step, corner[1] + pixel]
            for j in range(pixel * step, pixel * step + step):
                col = np.uintp(j)
                f = ids[row, col]
                if f < 0:
                    samples[row, col] = behind
                    continue
                plane = planes[np.uintp(f)]
                if not known[np.uintp(f)]:
                    known[np.uintp(f)] = 1
                    a, b, c = np.uintp(faces[f, 0]), np.uintp(faces[f, 1]), np.uintp(faces[f, 2])
                    va, vb, vc = brightness[f, 0], brightness[f, 1], brightness[f, 2]
                    x, y = screen[a, 0], screen[a, 1]
                    xb, yb, xc, yc = screen[b, 0] - x, screen[b, 1] - y, screen[c, 0] - x, screen[c, 1] - y
                    # brightness less that of the first corner, over depth, is linear on the screen
                    qb, qc = (vb - va) * screen[b, 2], (vc - va) * screen[c, 2]
                    area = xb * yc - xc * yb
                    plane[0], plane[1] = (qb * yc - qc * yb) / area, (xb * qc - xc * qb) / area
                    plane[2], plane[3], plane[4] = x - half, y - half, va
                    plane[5], plane[6] = min(va, vb, vc), max(va, vb, vc)
                across, down = number(j) - plane[2], number(i) - plane[3]
                value = plane[4] + (plane[0] * across + plane[1] * down) / inverse[row, col]
                samples[row, col] = min(max(value, plane[5]), plane[6])


@compiled
def outlines(planes: Any, kind: Any, eyes: Any, outline: Any) -> None:
    """Which edges are outlines: of one face, or both faces on one side of them.

    Args:
        planes: (2, 4, E): for the planes of both faces, n and d such that n·x = d; 0 for faces of no area.
        kind: (E,), of :class:`..topology.Edges`.
        eyes: (B, 3), from where the object is seen.
        outline: (B, E), gets 1 or 0.
    """
    some = 1024  # edges that stay in a processor's cache
    for first in range(0, kind.size, some):
        last = min(first + some, kind.size)
        for b in range(eyes.shape[0]):
            x, y, z = eyes[b, 0], eyes[b, 1], eyes[b, 2]
            row = outline[b]
            for k in range(last - first):
                e = np.uintp(first) + np.uintp(k)
                side = planes[0, 0, e] * x + planes[0, 1, e] * y + planes[0, 2, e] * z - planes[0, 3, e]
                other = planes[1, 0, e] * x + planes[1, 1, e] * y + planes[1, 2, e] * z - planes[1, 3, e]
                row[e] = (kind[e] == 1) | (side * other >= 0)


@compiled
def visible_edges(
    screen: Any,
    ends: Any,
    kind: Any,
    outline: Any,
    listed: Any,
    inverse: Any,
    slots: Any,
    places: Any,
    crossings: Any,
    followed: Any,
) -> int:
    """Where edges that can be seen cross the links between neighbouring samples.

    An edge is followed sample by sample along both axes.  It is kept where it lies in front of what is behind; of
    several on one link, the outermost of the nearer surface where there is a gap in depth, else the nearest.

    Args:
        ends, kind: of :class:`..topology.Edges`.
        outline: (E,), of :func:`outlines`.
        listed: (E,), scratch.
        slots: (2, H, W): gets 0, or 1 more than which entry of the next two belongs to the link from sample (i, j)
            down [0] or right [1].
        places: (N, 3): axis, row and column of that link.
        crossings: (N, 4): how far along the link the edge crosses, in 0…1; the edge's slope there, samples along the
            link for each sample across; its 1 / depth; 1 if the link is along the edge's minor axis, on which it is
            measured, else 0.
        followed: (N,): which edge.

    Returns:
        The number of links crossed, at most N; those beyond are left out.
    """
    number = screen.dtype.type
    zero, half, one = number(0), number(0.5), number(1)
    near_enough, gap_from = number(1 - 0.004), number(0.05)
    slots[:] = 0
    count = 0
    many = 0
    for e in range(kind.size):
        listed[np.uintp(many)] = e
        many += (kind[e] | outline[e]) != 0
    for e in listed[:many]:
        a, b = np.uintp(ends[e, 0]), np.uintp(ends[e, 1])
        xa, ya, wa = screen[a, 0], screen[a, 1], screen[a, 2]
        xb, yb, wb = screen[b, 0], screen[b, 1], screen[b, 2]
        if not (wa > 0 and wb > 0):
            continue
        steep = abs(yb - ya) > abs(xb - xa)
        for axis in range(2):
            # links down are crossed at the middles of columns, links to the right at those of rows
            if axis == 0:
                p0, q0, p1, q1 = xa, ya, xb, yb
                across, along = inverse.shape[1], inverse.shape[0]
            else:
                p0, q0, p1, q1 = ya, xa, yb, xb
                across, along = inverse.shape
            w0, w1 = wa, wb
            if p1 < p0:
                p0, q0, w0, p1, q1, w1 = p1, q1, w1, p0, q0, w0
            beyond = number(across)
            first = int(np.ceil(min(beyond, max(zero, p0 - half))))
            last = int(np.ceil(max(zero, min(beyond, p1 - half)))) - 1
            if first > last:
                continue
            slope, deepening = (q1 - q0) / (p1 - p0), (w1 - w0) / (p1 - p0)
            measured = steep == (axis == 1)
            end = number(along - 1)
            for p in range(first, last + 1):
                further = number(p) + half - p0
                q = q0 + further * slope - half
                if not (q >= 0 and q < end):
                    continue
                k = int(q)
                w = w0 + further * deepening
                i, j = (np.uintp(k), np.uintp(p)) if axis == 0 else (np.uintp(p), np.uintp(k))
                here, there = inverse[i, j], inverse[i + np.uintp(1 - axis), j + np.uintp(axis)]
                low, high = min(here, there), max(here, there)
                if high == 0:
                    continue
                gap = high - low > gap_from * high
                if gap:
                    if not outline[e] or w < half * (low + high):
                        continue
                elif w < near_enough * low:
                    continue
                t = q - number(k)
                h = slots[axis, i, j] - 1
                if h < 0:
                    if count == places.shape[0]:
                        continue
                    h = count
                    count += 1
                    slots[axis, i, j] = count
                    places[h, 0], places[h, 1], places[h, 2] = axis, i, j
                elif gap:
                    if (t <= crossings[h, 0]) if here > there else (t >= crossings[h, 0]):
                        continue
                elif crossings[h, 2] >= w:
                    continue
                crossings[h, 0], crossings[h, 1], crossings[h, 2] = t, slope, w
                crossings[h, 3] = one if measured else zero
                followed[h] = e
    return count


@compiled
def blend(
    samples: Any,
    ids: Any,
    inverse: Any,
    slots: Any,
    places: Any,
    crossings: Any,
    count: int,
    corner: Any,
    step: int,
    image: Any,
    motion: Any,
) -> None:
    """Samples to pixels: the mean of a pixel's samples, with each visible edge where it crosses between samples.

    Args:
        image: (H, W) of pixels, gets the brightness inside the box.
        motion: (4, H, W), or (0, H, W) for none: inside the box: gets less Σ of the brightness differences
            along x [0] and y [2], and of the same times 1 / depth [1], [3].  When surfaces at 1 / depth w move by
            a + b w pixels, the pixel changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """
    number = samples.dtype.type
    zero, half, one = number(0), number(0.5), number(1)
    side = one / number(step)
    share = side * side
    moves = motion.shape[0] > 0
    height, width = samples.shape
    # of this row of pixels and the next, sample by sample: brightness, and what makes the four kinds of motion
    sums = np.zeros((2, 5, width), samples.dtype)
    links = np.zeros((2, width), samples.dtype)
    for row in range(height // step):
        for i in range(row * step, row * step + step):
            here = np.uintp(i)
            for j in range(width):
                sums[0, 0, np.uintp(j)] += samples[here, np.uintp(j)]
            if not moves:
                continue
            # Where brightness changes without an edge, half-way between two samples, both move.  One loop for each
            # step, since only short ones are turned into instructions for eight links at a time.
            for axis in range(2):
                if axis == 0 and i + 1 == height:
                    continue
                there, shift = np.uintp(i + 1 - axis), np.uintp(axis)
                for first in range(width - axis):
                    j = np.uintp(first)
                    d = samples[there, j + shift] - samples[here, j]
                    links[0, j] = d if slots[axis, here, j] == 0 else zero
                for first in range(width - axis):
                    j = np.uintp(first)
                    w, w2 = inverse[here, j], inverse[there, j + shift]
                    w = half * (w + w2) if ids[here, j] == ids[there, j + shift] else max(w, w2)
                    d = links[0, j]
                    links[0, j] = d if w > 0 else zero
                    links[1, j] = d * w
                other = np.uintp((i + 1 - axis) // step - row)
                for k in range(2):
                    kind = np.uintp(3 - 2 * axis + k)
                    for j in range(width - axis):
                        sums[0, kind, np.uintp(j)] -= links[np.uintp(k), np.uintp(j)]
                    for j in range(width - axis):
                        sums[other, kind, np.uintp(j) + shift] -= links[np.uintp(k), np.uintp(j)]
        y, left, right = corner[0] + row, corner[1], corner[1] + width // step
        _pool(sums[0, 0], step, share, image[y, left:right])
        for kind in range(motion.shape[0]):
            _pool(sums[0, 1 + kind], step, half * side, motion[kind, y, left:right])
        sums[0] = sums[1]
        sums[1] = 0
    for h in range(count):
        if crossings[h, 3] == 0:  # counted on the links of the other axis
            continue
        axis, i, j = places[h, 0], places[h, 1], places[h, 2]
        i2, j2 = i + 1 - axis, j + axis
        d = samples[i2, j2] - samples[i, j]
        t = crossings[h, 0]
        y, x = (i // step, j // step) if t < half else (i2 // step, j2 // step)
        y, x = corner[0] + y, corner[1] + x
        image[y, x] += (half - t) * d * share
        if moves:
            slope, w = crossings[h, 1], crossings[h, 2]
            k = 2 - 2 * axis
            d *= side
            motion[k, y, x] -= d
            motion[k + 1, y, x] -= d * w
            d *= slope
            motion[2 - k, y, x] += d
            motion[3 - k, y, x] += d * w


@compiled
def _pool(line: Any, step: int, factor: Any, found: Any) -> None:
    """Sums of ``step`` neighbours each on a line, times ``factor``."""
    if step == 1:  # without a loop for each, several at a time
        for x in range(found.size):
            found[x] = factor * line[x]
        return
    for x in range(found.size):
        total = factor - factor
        for k in range(x * step, x * step + step):
            total += line[np.uintp(k)]
        found[x] = factor * total
