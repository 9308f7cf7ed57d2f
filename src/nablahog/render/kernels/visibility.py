"""Which triangle is seen at each sample: a z-buffer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compile import compiled

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
        ids: (H, W), gets the triangle or -1, inside the box.
        inverse: (H, W), gets 1 / depth or 0, inside the box.
    """
    number = screen.dtype.type
    zero, half, one = number(0), number(0.5), number(1)
    top, bottom, left, right = number(box[0]), number(box[1] - 1), number(box[2]), number(box[3] - 1)
    ids[box[0] : box[1], box[2] : box[3]] = -1
    inverse[box[0] : box[1], box[2] : box[3]] = 0
    # First the spans of many triangles, one for each row of samples, then their samples: how many samples a span has
    # is hard to predict, and a processor that guesses wrong must not have to wait for the span's ends as well.
    many = 1024
    spans = np.empty((many + ids.shape[0], 4), np.int32)
    planes = np.empty((many + ids.shape[0], 5), screen.dtype)
    f = 0
    while f < faces.shape[0]:
        count = 0
        while f < faces.shape[0] and count < many:
            face = f
            f += 1
            a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
            xa, ya, wa = screen[a, 0], screen[a, 1], screen[a, 2]
            xb, yb, wb = screen[b, 0], screen[b, 1], screen[b, 2]
            xc, yc, wc = screen[c, 0], screen[c, 1], screen[c, 2]
            first = np.ceil(max(top, min(ya, yb, yc) - half))
            last = np.floor(min(bottom, max(ya, yb, yc) - half))
            if first > last or not (wa > 0 and wb > 0 and wc > 0):
                continue
            if np.ceil(max(left, min(xa, xb, xc) - half)) > np.floor(min(right, max(xa, xb, xc) - half)):
                continue
            area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
            if area == 0:
                continue
            over = one / area
            by_x = ((wb - wa) * (yc - ya) - (wc - wa) * (yb - ya)) * over
            by_y = ((xb - xa) * (wc - wa) - (xc - xa) * (wb - wa)) * over
            least, most = min(wa, wb, wc), max(wa, wb, wc)
            # the corners from top to bottom: two triangles then compute a common edge alike, and leave no gap
            x0, y0, x1, y1, x2, y2 = xa, ya, xb, yb, xc, yc
            if y1 < y0:
                x0, y0, x1, y1 = x1, y1, x0, y0
            if y2 < y0:
                x0, y0, x2, y2 = x2, y2, x0, y0
            if y2 < y1:
                x1, y1, x2, y2 = x2, y2, x1, y1
            whole = (x2 - x0) / (y2 - y0) if y2 > y0 else zero
            upper = (x1 - x0) / (y1 - y0) if y1 > y0 else zero
            lower = (x2 - x1) / (y2 - y1) if y2 > y1 else zero
            for i in range(int(first), int(last) + 1):
                y = number(i) + half
                p = x0 + (y - y0) * whole
                q, below = x0 + (y - y0) * upper, x1 + (y - y1) * lower
                q = q if y < y1 else below
                # within the image, since no integer is as large as numbers can be
                start = int(np.ceil(min(right + one, max(left, min(p, q) - half))))
                stop = int(np.floor(max(left - one, min(right, max(p, q) - half))))
                n = np.uintp(count)
                spans[n, 0], spans[n, 1], spans[n, 2], spans[n, 3] = i, start, stop, face
                planes[n, 0], planes[n, 1], planes[n, 2] = wa + by_y * (y - ya), by_x, xa - half
                planes[n, 3], planes[n, 4] = least, most
                count += start <= stop
        for n in range(count):
            i, face = np.uintp(spans[n, 0]), spans[n, 3]
            w0, by_x, x, least, most = planes[n, 0], planes[n, 1], planes[n, 2], planes[n, 3], planes[n, 4]
            for span in range(spans[n, 1], spans[n, 2] + 1):
                j = np.uintp(span)
                w = min(max(w0 + by_x * (number(span) - x), least), most)  # slivers have wild planes
                if w > inverse[i, j]:
                    inverse[i, j] = w
                    ids[i, j] = face
