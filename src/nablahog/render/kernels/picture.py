"""Brightness of samples, visible edges between them, and from both the image with its motion."""

from __future__ import annotations

import math
from typing import Any

from ...compile import compiled


@compiled
def shade(
    screen: Any,
    faces: Any,
    corners: Any,
    box: Any,
    ids: Any,
    inverse: Any,
    background: Any,
    step: int,
    planes: Any,
    samples: Any,
) -> None:
    """The brightness of each sample inside the box: perspective-correct between the corners of its triangle.

    Args:
        corners: (F, 3) brightness at the corners of each face.
        background: (H, W), a value for each pixel.
        step: samples of a pixel, along a side.
        planes: (F, 6), scratch, its last column 0 before and after.
        samples: gets the brightness.
        others: as for :func:`.visibility.visibility`.
    """
    half = screen.dtype.type(0.5)
    before = -1
    v0 = gx = gy = g0 = low = high = half - half
    flat = True
    for i in range(box[0], box[1]):
        row = i // step
        y = i + half
        for j in range(box[2], box[3]):
            f = ids[i, j]
            if f < 0:
                samples[i, j] = background[row, j // step]
                continue
            if f != before:
                before = f
                b0, b1, b2 = corners[f, 0], corners[f, 1], corners[f, 2]
                flat = b0 == b1 and b1 == b2
                v0 = b0
                if not flat:
                    if planes[f, 5] == 0:
                        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
                        xa, ya = screen[a, 0], screen[a, 1]
                        xb, yb, xc, yc = screen[b, 0] - xa, screen[b, 1] - ya, screen[c, 0] - xa, screen[c, 1] - ya
                        # brightness less that of the first corner, over depth, is linear on the screen
                        qb, qc = (b1 - b0) * screen[b, 2], (b2 - b0) * screen[c, 2]
                        area = xb * yc - xc * yb
                        planes[f, 0] = (qb * yc - qc * yb) / area
                        planes[f, 1] = (xb * qc - xc * qb) / area
                        planes[f, 2] = -planes[f, 0] * xa - planes[f, 1] * ya
                        planes[f, 3], planes[f, 4], planes[f, 5] = min(b0, b1, b2), max(b0, b1, b2), 1
                    gx, gy, g0 = planes[f, 0], planes[f, 1], planes[f, 2]
                    low, high = planes[f, 3], planes[f, 4]
            if flat:
                samples[i, j] = v0
            else:
                v = v0 + (gx * (j + half) + gy * y + g0) / inverse[i, j]
                samples[i, j] = min(max(v, low), high)
    for f in range(planes.shape[0]):
        planes[f, 5] = 0


@compiled
def visible_edges(
    screen: Any,
    ends: Any,
    opposite: Any,
    kind: Any,
    box: Any,
    ids: Any,
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
        ends, opposite, kind: of :class:`..topology.Edges`.
        slots: (2, H, W), -1 before: gets which entry of the next two belongs to the link from sample (i, j) down [0] or
            right [1].
        places: (N, 3): axis, row and column of that link.
        crossings: (N, 4): how far along the link the edge crosses, in 0…1; the edge's slope there, samples along the
            link for each sample across; its 1 / depth; 1 if the link is along the edge's minor axis, on which it is
            measured, else 0.
        followed: (N,): which edge.

    Returns:
        The number of links crossed, at most N; those beyond are left out.
    """
    one = screen.dtype.type(1)
    half = screen.dtype.type(0.5)
    near_enough, gap_from = screen.dtype.type(1 - 0.004), screen.dtype.type(0.01)
    count = 0
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        xa, ya, wa = screen[a, 0], screen[a, 1], screen[a, 2]
        xb, yb, wb = screen[b, 0], screen[b, 1], screen[b, 2]
        if not (wa > 0 and wb > 0):
            continue
        outline = kind[e] == 1
        if not outline:  # both faces on one side of it: a fold
            c, d = opposite[e, 0], opposite[e, 1]
            side = (xb - xa) * (screen[c, 1] - ya) - (screen[c, 0] - xa) * (yb - ya)
            other = (xb - xa) * (screen[d, 1] - ya) - (screen[d, 0] - xa) * (yb - ya)
            outline = side * other >= 0
            if not outline and kind[e] == 0:
                continue
        steep = abs(yb - ya) > abs(xb - xa)
        for axis in range(2):
            # links down are crossed at the middles of columns, links to the right at those of rows
            if axis == 0:
                p0, q0, p1, q1 = xa, ya, xb, yb
                low, high, short, long = box[2], box[3], box[0], box[1]
            else:
                p0, q0, p1, q1 = ya, xa, yb, xb
                low, high, short, long = box[0], box[1], box[2], box[3]
            if p0 == p1:
                continue
            w0, w1 = wa, wb
            if p1 < p0:
                p0, q0, w0, p1, q1, w1 = p1, q1, w1, p0, q0, w0
            slope, deepening = (q1 - q0) / (p1 - p0), (w1 - w0) / (p1 - p0)
            measured = steep == (axis == 1)
            first = int(max(math.ceil(p0 - half), low))
            last = int(min(math.ceil(p1 - half) - 1, high - 1))
            for p in range(first, last + 1):
                along = p + half - p0
                q = q0 + along * slope - half
                if not (q >= short and q < long - 1):
                    continue
                k = int(q)
                w = w0 + along * deepening
                i, j, i2, j2 = (k, p, k + 1, p) if axis == 0 else (p, k, p, k + 1)
                if ids[i, j] < 0 and ids[i2, j2] < 0:
                    continue
                here, there = inverse[i, j], inverse[i2, j2]
                low_w, high_w = min(here, there), max(here, there)
                gap = high_w - low_w > gap_from * high_w
                if gap:
                    if not outline or w < half * (low_w + high_w):
                        continue
                elif w < near_enough * low_w:
                    continue
                t = q - k
                h = slots[axis, i, j]
                if h < 0:
                    if count == places.shape[0]:
                        continue
                    h = count
                    count += 1
                    slots[axis, i, j] = h
                    places[h, 0], places[h, 1], places[h, 2] = axis, i, j
                elif gap:
                    if (t <= crossings[h, 0]) if here > there else (t >= crossings[h, 0]):
                        continue
                elif crossings[h, 2] >= w:
                    continue
                crossings[h, 0], crossings[h, 1], crossings[h, 2] = t, slope, w
                crossings[h, 3] = one if measured else one - one
                followed[h] = e
    return count


@compiled
def blend(
    samples: Any, ids: Any, inverse: Any, box: Any, slots: Any, crossings: Any, step: int, image: Any, motion: Any
) -> None:
    """Samples to pixels: the mean of a pixel's samples, with each visible edge where it crosses between samples.

    Args:
        image: (H, W) of pixels, gets the brightness inside the box.
        motion: (4, H, W), or (0, H, W) for none: inside the box: gets less Σ of the brightness differences
            along x [0] and y [2], and of the same times 1 / depth [1], [3].  When surfaces at 1 / depth w move by
            a + b w pixels, the pixel changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """
    zero = samples.dtype.type(0)
    half, one = samples.dtype.type(0.5), samples.dtype.type(1)
    share, side = one / (step * step), one / step
    share, side = samples.dtype.type(share), samples.dtype.type(side)
    moves = motion.shape[0] > 0
    for row in range(box[0] // step, box[1] // step):
        for col in range(box[2] // step, box[3] // step):
            total = zero
            for i in range(row * step, row * step + step):
                for j in range(col * step, col * step + step):
                    total += samples[i, j]
            image[row, col] = total * share
    for i in range(box[0], box[1]):
        row = i // step
        for axis in range(2):
            i2 = i + 1 - axis
            if i2 >= box[1]:
                continue
            row2 = i2 // step
            for j in range(box[2], box[3] - axis):
                j2 = j + axis
                here, there = ids[i, j], ids[i2, j2]
                if here < 0 and there < 0:
                    continue
                d = samples[i2, j2] - samples[i, j]
                if d == 0:
                    continue
                col, col2 = j // step, j2 // step
                h = slots[axis, i, j]
                if h < 0:  # where it is between both samples, nobody knows
                    if moves:
                        w = max(inverse[i, j], inverse[i2, j2])
                        if here == there:
                            w = half * (inverse[i, j] + inverse[i2, j2])
                        k = 2 - 2 * axis
                        d *= half * side
                        motion[k, row, col] -= d
                        motion[k + 1, row, col] -= d * w
                        motion[k, row2, col2] -= d
                        motion[k + 1, row2, col2] -= d * w
                    continue
                if crossings[h, 3] == 0:  # counted on the links of the other axis
                    continue
                t = crossings[h, 0]
                r, c = (row, col) if t < half else (row2, col2)
                image[r, c] += (half - t) * d * share
                if moves:
                    w, m = crossings[h, 2], crossings[h, 1]
                    k = 2 - 2 * axis
                    d *= side
                    motion[k, r, c] -= d
                    motion[k + 1, r, c] -= d * w
                    d *= m
                    motion[2 - k, r, c] += d
                    motion[3 - k, r, c] += d * w


@compiled
def forget(slots: Any, places: Any, count: int) -> None:
    """Makes ``slots`` -1 again."""
    for h in range(count):
        slots[places[h, 0], places[h, 1], places[h, 2]] = -1
