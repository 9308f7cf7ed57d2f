"""Which triangle is seen at each sample: a z-buffer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...runtime.compile import compiled

# np.ceil and np.floor, since math's own are calls of a library; np.uintp, since other indices may count from the end


@compiled
def project(points: Any, rotation: Any, distance: Any, focal: Any, middle: Any, nearest: Any, screen: Any) -> Any:
    """Points (V, 3) of an object to ``screen`` (V, 3): x and y in samples, and 1 / depth, 0 for depths below
    ``nearest``; returns the least depth."""
    least = distance - distance + math.inf
    for v in range(points.shape[0]):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + distance
        inverse = 1 / depth
        screen[v, 0] = focal * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) * inverse + middle[0]
        screen[v, 1] = focal * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) * inverse + middle[1]
        screen[v, 2] = inverse if depth >= nearest else depth - depth
        least = min(least, depth)
    return least


@compiled
def frame(screen: Any, step: int, height: int, width: int, box: Any) -> None:
    """The part of the image that the points (V, 3) may cover; makes their x and y count from its corner.

    One sample wider on each side, for the edges; then whole blocks of ``step`` samples, pixels; inside the image.
    Points at 1 / depth 0 do not count.

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
def visibility(screen: Any, faces: Any, box: Any, ids: Any, inverse: Any) -> None:
    """The nearest triangle at each sample of the image, and 1 / depth there.

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
    # Three loops over many triangles at a time.  Which triangles have samples, on how many lines, and how many on each
    # is hard to predict, and a processor that guesses wrong must not have to wait for what the guess was made from.
    many = 1024
    reaching = np.empty((many, 4), np.int32)
    spans = np.empty((many + max(ids.shape), 4), np.int32)
    planes = np.empty((many + max(ids.shape), 4), screen.dtype)
    for first in range(0, faces.shape[0], many):
        found = _reaching(screen, faces, first, min(first + many, faces.shape[0]), box, reaching)
        done = 0
        while done < found:
            left = reaching[done:found]
            used, count = _spans(screen, faces, left, box, ids.shape[1], spans, planes, many)
            done += used
            _draw(spans, planes, count, ids.reshape(-1), inverse.reshape(-1))


@compiled
def _reaching(screen: Any, faces: Any, first: int, stop: int, box: Any, found: Any) -> int:
    """The triangles among ``first`` … ``stop`` - 1 that have a sample in the box around them.

    Args:
        found: (N, 4), gets such a triangle, how its samples are best gone through, 0 row by row or 1 column by column,
            and the first and the last of these lines.

    Returns:
        Their number.
    """
    number = screen.dtype.type
    half = number(0.5)
    top, bottom, left, right = number(box[0]), number(box[1] - 1), number(box[2]), number(box[3] - 1)
    most = number(max(box[1], box[3]))
    count = 0
    for face in range(first, stop):
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        x0, y0, x1, y1, x2, y2 = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1], screen[c, 0], screen[c, 1]
        y_low, y_high, x_low, x_high = min(y0, y1, y2), max(y0, y1, y2), min(x0, x1, x2), max(x0, x1, x2)
        row, last_row = np.ceil(max(top, y_low - half)), np.floor(min(bottom, y_high - half))
        col, last_col = np.ceil(max(left, x_low - half)), np.floor(min(right, x_high - half))
        # rounding of a corner far away may be of any size: all that have one are gone through alike
        by_column = (last_row - row > last_col - col) & (y_high - y_low < most) & (x_high - x_low < most)
        n = np.uintp(count)
        found[n, 0], found[n, 1] = face, by_column
        found[n, 2], found[n, 3] = col if by_column else row, last_col if by_column else last_row
        count += (row <= last_row) & (col <= last_col)
    return count


@compiled
def _spans(
    screen: Any, faces: Any, listed: Any, box: Any, width: int, spans: Any, planes: Any, room: int
) -> tuple[int, int]:
    """The samples of some triangles, line by line.

    Args:
        listed: of :func:`_reaching`.
        spans: (N, 4), gets the first sample in an image of ``width``, the step to the next, their number, the triangle.
        planes: (N, 4), gets 1 / depth at the first, its step to the next, and the least and the most of the triangle.
        room: once there are so many spans, no other triangle is begun.

    Returns:
        How many of ``listed`` are done, and the number of spans.
    """
    number = screen.dtype.type
    zero, half, one, infinite = number(0), number(0.5), number(1), number(np.inf)
    # so much that a sample on a common edge of two triangles is in one of them, if they are not gone through alike
    rounding = np.finfo(screen.dtype).eps * number(2 * max(box[1], box[3]))
    done = count = 0
    while done < len(listed) and count < room:
        face, along = listed[np.uintp(done), 0], np.uintp(listed[np.uintp(done), 1])
        begin, end = listed[np.uintp(done), 2], listed[np.uintp(done), 3]
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
        low_q, high_q = number(box[2 * across]), number(box[2 * across + np.uintp(1)] - 1)
        low_q, high_q = max(low_q, min(qa, qb, qc) - half), min(high_q, max(qa, qb, qc) - half)
        step_p, step_q = (1, width) if along else (width, 1)
        p1, end1, q1, slope1, from1, to1 = _side(pa, qa, pb, qb, turn, more, infinite)
        p2, end2, q2, slope2, from2, to2 = _side(pb, qb, pc, qc, turn, more, infinite)
        p3, end3, q3, slope3, from3, to3 = _side(pc, qc, pa, qa, turn, more, infinite)
        qa -= half
        for line in range(begin, end + 1):
            p = number(line) + half
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
            planes[n, 0], planes[n, 1] = wa + by_p * (p - pa) + by_q * (start - qa), by_q
            planes[n, 2], planes[n, 3] = least, most
            count += start <= last
    return done, count


@compiled
def _side(
    p0: Any, q0: Any, p1: Any, q1: Any, turn: Any, more: Any, infinite: Any
) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Of a side of a triangle, whose corners go round in the direction ``turn``: from where to where in p it bounds
    lines; q where it begins, at the lower p for both triangles at an edge, and how far q goes for each p; and what to
    add to q for the least and for the most on a line, so much that it is no bound where it is none."""
    # in float64: of a corner millions of samples away, the products below would be off by a sample
    forth = np.float64(p1) - np.float64(p0)
    slope = (np.float64(q1) - np.float64(q0)) / forth if forth != 0 else forth
    turned = forth * turn
    low, high = -more if turned > 0 else -infinite, more if turned < 0 else infinite
    return min(p0, p1), max(p0, p1), q0 if forth >= 0 else q1, slope, low, high


@compiled
def _draw(spans: Any, planes: Any, count: int, ids: Any, inverse: Any) -> None:
    """Draws the first ``count`` spans of :func:`_spans` over the samples of an image, flat."""
    number = planes.dtype.type
    for n in range(count):
        at, step, face = np.uintp(spans[n, 0]), np.uintp(spans[n, 1]), spans[n, 3]
        w0, by, least, most = planes[n, 0], planes[n, 1], planes[n, 2], planes[n, 3]
        for k in range(spans[n, 2]):
            w = min(max(w0 + by * number(k), least), most)  # slivers have wild planes
            if w > inverse[at]:
                inverse[at] = w
                ids[at] = face
            at += step
