"""Rasterisation with a depth buffer: the nearest triangle at each sample."""

from __future__ import annotations

import math

import numpy as np

from ...runtime.compile import borrowing, compiled
from .arrays import Floats, Indices, Integers

_BATCH = 1024  # triangles that go through the three loops of rasterize together

# np.ceil and np.floor are instructions, math.ceil and math.floor library calls; unsigned indices (np.uintp) need no
# test for negative ones


@borrowing
def project(
    points: Floats, rotation: Floats, distance: float, focal: float, centre: Floats, nearest: float, screen: Floats
) -> float:
    """Projects points (V, 3) of an object to ``screen`` (V, 3): x and y in samples, and 1 / depth.

    1 / depth is 0 for depths below ``nearest``.  Returns the least depth.
    """
    least = distance - distance + math.inf
    for v in range(points.shape[0]):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + distance
        inverse = 1 / depth
        screen[v, 0] = focal * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) * inverse + centre[0]
        screen[v, 1] = focal * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) * inverse + centre[1]
        screen[v, 2] = inverse if depth >= nearest else depth - depth
        least = min(least, depth)
    return least


@borrowing
def bounding_box(screen: Floats, step: int, height: int, width: int, box: Indices) -> None:
    """Finds the pixels that the points (V, 3) may cover, and moves the origin of their x and y to its corner.

    The box is one sample wider on each side, for the edges, and made of whole pixels inside the image.  Points at
    1 / depth 0 do not count.

    Args:
        height, width: of the image, in pixels.
        box: gets rows [0] … [1] and columns [2] … [3] of pixels.
    """
    top, left, bottom, right = math.inf, math.inf, -math.inf, -math.inf
    for v in range(screen.shape[0]):
        if screen[v, 2] > 0:
            top, bottom = min(top, screen[v, 1]), max(bottom, screen[v, 1])
            left, right = min(left, screen[v, 0]), max(right, screen[v, 0])
    box[0] = int(max(0, min(height, np.floor((np.floor(top) - 1) / step))))
    box[1] = int(max(0, min(height, np.ceil((np.ceil(bottom) + 1) / step))))
    box[2] = int(max(0, min(width, np.floor((np.floor(left) - 1) / step))))
    box[3] = int(max(0, min(width, np.ceil((np.ceil(right) + 1) / step))))
    x, y = screen.dtype.type(box[2] * step), screen.dtype.type(box[0] * step)
    for v in range(screen.shape[0]):
        screen[v, 0] -= x
        screen[v, 1] -= y


@compiled
def rasterize(screen: Floats, faces: Integers, box: Indices, ids: Integers, inverse: Floats) -> None:
    """Finds the nearest triangle at each sample of the image, and 1 / depth there.

    Args:
        screen: (V, 3): x and y in samples, sample (row i, column j) being at (j + ½, i + ½), and 1 / depth.
            Triangles with a corner at 1 / depth ≤ 0 or NaN are not drawn.
        faces: (F, 3) into the points.
        box: rows [0] … [1] and columns [2] … [3] of samples outside of which there is nothing to draw.
        ids: (H, W), contiguous, gets the triangle or -1, inside the box.
        inverse: (H, W), contiguous, gets 1 / depth or 0, inside the box.
    """
    ids[box[0] : box[1], box[2] : box[3]] = -1
    inverse[box[0] : box[1], box[2] : box[3]] = 0
    # Three loops over a batch of triangles.  Which triangles have samples, on how many lines, and how many on each, is
    # hard to predict: a mispredicted branch in one loop must not wait for the arithmetic that it depends on.
    triangles = np.empty((_BATCH, 4), np.int32)
    spans = np.empty((_BATCH + max(ids.shape), 4), np.int32)
    depths = np.empty((_BATCH + max(ids.shape), 4), screen.dtype)
    for first in range(0, faces.shape[0], _BATCH):
        listed = _list_triangles(screen, faces, first, min(first + _BATCH, faces.shape[0]), box, triangles)
        done = 0
        while done < listed:
            rest = triangles[done:listed]
            used, count = _list_spans(screen, faces, rest, box, ids.shape[1], spans, depths)
            done += used
            _draw_spans(spans, depths, count, ids.reshape(-1), inverse.reshape(-1))


@borrowing
def _list_triangles(screen: Floats, faces: Integers, first: int, stop: int, box: Indices, triangles: Integers) -> int:
    """Lists the triangles among ``first`` … ``stop`` - 1 whose bounding box has a sample.

    Args:
        triangles: (N, 4), gets the triangle, in which direction it is scanned, 0 row by row or 1 column by column, and
            the first and the last of these lines.

    Returns:
        Their number.
    """
    real = screen.dtype.type
    half = real(0.5)
    top, bottom, left, right = real(box[0]), real(box[1] - 1), real(box[2]), real(box[3] - 1)
    most = real(max(box[1], box[3]))
    count = 0
    for face in range(first, stop):
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        x0, y0, x1, y1, x2, y2 = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1], screen[c, 0], screen[c, 1]
        y_low, y_high, x_low, x_high = min(y0, y1, y2), max(y0, y1, y2), min(x0, x1, x2), max(x0, x1, x2)
        row, last_row = np.ceil(max(top, y_low - half)), np.floor(min(bottom, y_high - half))
        col, last_col = np.ceil(max(left, x_low - half)), np.floor(min(right, x_high - half))
        # the rounding error of a corner far away may be of any size: triangles that have one are all scanned alike
        by_column = (last_row - row > last_col - col) & (y_high - y_low < most) & (x_high - x_low < most)
        n = np.uintp(count)
        triangles[n, 0], triangles[n, 1] = face, by_column
        triangles[n, 2], triangles[n, 3] = col if by_column else row, last_col if by_column else last_row
        count += (row <= last_row) & (col <= last_col)
    return count


@borrowing
def _list_spans(
    screen: Floats, faces: Integers, triangles: Integers, box: Indices, width: int, spans: Integers, depths: Floats
) -> tuple[int, int]:
    """Scans triangles line by line, and lists the span of samples inside them on each line.

    Once there are as many spans as triangles in a batch, no other triangle is begun.

    Args:
        triangles: of :func:`_list_triangles`.
        spans: (N, 4), gets the first sample in an image of ``width``, the step to the next, their number, the triangle.
        depths: (N, 4), gets 1 / depth at the first sample, its step to the next, and its least and most in the
            triangle.

    Returns:
        The number of ``triangles`` scanned, and the number of spans.
    """
    real = screen.dtype.type
    zero, half, one, infinite = real(0), real(0.5), real(1), real(np.inf)
    # so much that a sample on a common edge of two triangles is in one of them, if they are not scanned alike
    rounding = np.finfo(screen.dtype).eps * real(2 * max(box[1], box[3]))
    done = count = 0
    while done < len(triangles) and count < _BATCH:
        face, along = triangles[np.uintp(done), 0], np.uintp(triangles[np.uintp(done), 1])
        begin, end = triangles[np.uintp(done), 2], triangles[np.uintp(done), 3]
        done += 1
        # one line after the other along p, and q on each
        across = np.uintp(1) - along
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        pa, qa, wa = screen[a, across], screen[a, along], screen[a, 2]
        pb, qb, wb = screen[b, across], screen[b, along], screen[b, 2]
        pc, qc, wc = screen[c, across], screen[c, along], screen[c, 2]
        area = (pb - pa) * (qc - qa) - (pc - pa) * (qb - qa)
        if not ((wa > 0) & (wb > 0) & (wc > 0) & (area != 0)):
            continue
        turn, more = one if area > 0 else -one, rounding if along else zero
        over = one / area
        by_p = ((wb - wa) * (qc - qa) - (wc - wa) * (qb - qa)) * over
        by_q = ((pb - pa) * (wc - wa) - (pc - pa) * (wb - wa)) * over
        least, most = min(wa, wb, wc), max(wa, wb, wc)
        low_q, high_q = real(box[2 * across]), real(box[2 * across + np.uintp(1)] - 1)
        low_q, high_q = max(low_q, min(qa, qb, qc) - half), min(high_q, max(qa, qb, qc) - half)
        step_p, step_q = (1, width) if along else (width, 1)
        p1, end1, q1, slope1, from1, to1 = _edge_bounds(pa, qa, pb, qb, turn, more, infinite)
        p2, end2, q2, slope2, from2, to2 = _edge_bounds(pb, qb, pc, qc, turn, more, infinite)
        p3, end3, q3, slope3, from3, to3 = _edge_bounds(pc, qc, pa, qa, turn, more, infinite)
        qa -= half
        for line in range(begin, end + 1):
            p = real(line) + half
            q, aside = q1 + (p - p1) * slope1 - half, (p < p1) | (p > end1)
            low, high = -infinite if aside else q + from1, infinite if aside else q + to1
            q, aside = q2 + (p - p2) * slope2 - half, (p < p2) | (p > end2)
            low, high = max(low, -infinite if aside else q + from2), min(high, infinite if aside else q + to2)
            q, aside = q3 + (p - p3) * slope3 - half, (p < p3) | (p > end3)
            low, high = max(low, -infinite if aside else q + from3), min(high, infinite if aside else q + to3)
            # within the image, since no integer is as large as numbers can be
            start, last = np.ceil(min(high_q + one, max(low_q, low))), np.floor(max(low_q - one, min(high_q, high)))
            n = np.uintp(count)
            spans[n, 0], spans[n, 1] = line * step_p + int(start) * step_q, step_q
            spans[n, 2], spans[n, 3] = int(last) - int(start) + 1, face
            depths[n, 0], depths[n, 1] = wa + by_p * (p - pa) + by_q * (start - qa), by_q
            depths[n, 2], depths[n, 3] = least, most
            count += start <= last
    return done, count


@borrowing
def _edge_bounds(
    p0: float, q0: float, p1: float, q1: float, turn: float, more: float, infinite: float
) -> tuple[float, float, float, float, float, float]:
    """How an edge of a triangle bounds the spans of the lines p.

    Args:
        p0, q0, p1, q1: its ends.
        turn: 1 or -1, the triangle's orientation.
        more: by how much a span is widened against rounding.
        infinite: infinity, in the type of the others.

    Returns:
        The lowest and the highest p; q at the lowest, which is the same corner for both triangles at an edge; its slope
        dq / dp; and what to add to q for the lower and the upper bound, infinite where the edge is no such bound.
    """
    # in float64: of a corner millions of samples away, the products below would be off by a sample
    forth = np.float64(p1) - np.float64(p0)
    slope = (np.float64(q1) - np.float64(q0)) / forth if forth != 0 else forth
    turned = forth * turn
    low, high = -more if turned > 0 else -infinite, more if turned < 0 else infinite
    return min(p0, p1), max(p0, p1), q0 if forth >= 0 else q1, slope, low, high


@borrowing
def _draw_spans(spans: Integers, depths: Floats, count: int, ids: Integers, inverse: Floats) -> None:
    """Draws the first ``count`` spans of :func:`_list_spans` with a depth test; the samples are flat."""
    real = depths.dtype.type
    for n in range(count):
        at, step, face = np.uintp(spans[n, 0]), np.uintp(spans[n, 1]), spans[n, 3]
        w0, by, least, most = depths[n, 0], depths[n, 1], depths[n, 2], depths[n, 3]
        for k in range(spans[n, 2]):
            w = min(max(w0 + by * real(k), least), most)  # 1 / depth of a sliver has a wild slope
            if w > inverse[at]:
                inverse[at] = w
                ids[at] = face
            at += step
