"""Which triangle is seen at each sample: a z-buffer."""

from __future__ import annotations

import math
from typing import Any

from ...compile import compiled


@compiled
def project(points: Any, rotation: Any, distance: Any, focal: Any, middle: Any, screen: Any) -> Any:
    """Points (V, 3) of an object to ``screen`` (V, 3): x and y in samples, and 1 / depth; returns the least depth."""
    least = distance - distance + math.inf
    for v in range(points.shape[0]):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + distance
        inverse = 1 / depth
        screen[v, 0] = focal * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) * inverse + middle[0]
        screen[v, 1] = focal * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) * inverse + middle[1]
        screen[v, 2] = inverse
        least = min(least, depth)
    return least


@compiled
def extent(screen: Any, step: int, height: int, width: int, box: Any) -> None:
    """``box``: the rows and columns of samples [0] … [1] and [2] … [3] that the points (V, 3) may cover.

    One sample wider on each side, for the edges; then whole blocks of ``step`` samples, pixels; inside the image.
    """
    top, left, bottom, right = math.inf, math.inf, -math.inf, -math.inf
    for v in range(screen.shape[0]):
        top, bottom = min(top, screen[v, 1]), max(bottom, screen[v, 1])
        left, right = min(left, screen[v, 0]), max(right, screen[v, 0])
    box[0] = int(min(max(math.floor(top) - 1, 0), height)) // step * step
    box[1] = min((int(min(max(math.ceil(bottom) + 1, 0), height)) + step - 1) // step * step, height)
    box[2] = int(min(max(math.floor(left) - 1, 0), width)) // step * step
    box[3] = min((int(min(max(math.ceil(right) + 1, 0), width)) + step - 1) // step * step, width)


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
    half = screen.dtype.type(0.5)
    top, bottom, left, right = box[0], box[1] - 1, box[2], box[3] - 1
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            ids[i, j] = -1
            inverse[i, j] = 0
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        xa, ya, wa = screen[a, 0], screen[a, 1], screen[a, 2]
        xb, yb, wb = screen[b, 0], screen[b, 1], screen[b, 2]
        xc, yc, wc = screen[c, 0], screen[c, 1], screen[c, 2]
        if not (wa > 0 and wb > 0 and wc > 0):
            continue
        low, high = max(min(ya, yb, yc) - half, top), min(max(ya, yb, yc) - half, bottom)
        near, far = max(min(xa, xb, xc) - half, left), min(max(xa, xb, xc) - half, right)
        first, last = int(math.ceil(low)), int(math.floor(high))
        if first > last or math.ceil(near) > math.floor(far):
            continue
        area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
        if area == 0:
            continue
        by_x = ((wb - wa) * (yc - ya) - (wc - wa) * (yb - ya)) / area
        by_y = ((xb - xa) * (wc - wa) - (xc - xa) * (wb - wa)) / area
        least, most = min(wa, wb, wc), max(wa, wb, wc)
        # the corners from top to bottom: two triangles then compute a common edge alike, and leave no gap
        x0, y0, x1, y1, x2, y2 = xa, ya, xb, yb, xc, yc
        if y1 < y0:
            x0, y0, x1, y1 = x1, y1, x0, y0
        if y2 < y0:
            x0, y0, x2, y2 = x2, y2, x0, y0
        if y2 < y1:
            x1, y1, x2, y2 = x2, y2, x1, y1
        whole = (x2 - x0) / (y2 - y0) if y2 > y0 else y0 - y0
        upper = (x1 - x0) / (y1 - y0) if y1 > y0 else y0 - y0
        lower = (x2 - x1) / (y2 - y1) if y2 > y1 else y0 - y0
        for i in range(first, last + 1):
            y = i + half
            p = x0 + (y - y0) * whole
            q = x0 + (y - y0) * upper if y < y1 else x1 + (y - y1) * lower
            start = int(math.ceil(max(min(p, q) - half, left)))
            stop = int(math.floor(min(max(p, q) - half, right)))
            w0 = wa + by_y * (y - ya) + by_x * (half - xa)
            for j in range(start, stop + 1):
                w = min(max(w0 + by_x * screen.dtype.type(j), least), most)  # slivers have wild planes
                if w > inverse[i, j]:
                    inverse[i, j] = w
                    ids[i, j] = f
