"""Silhouette edges of a mesh, and where visible edges cross between neighbouring samples."""

from __future__ import annotations

import numpy as np

from ...runtime.compile import borrowing, inlined
from ..edge_gradient import GAP, TOUCHING
from ..topology import BOUNDARY
from .arrays import AT, DEPTH, MEASURED, SLOPE, Bytes, Crossings, EdgeArrays, Floats, Integers

_CACHED = 1024  # edges that stay in a processor's cache


@borrowing
def silhouette_edges(edges: EdgeArrays, eyes: Floats, silhouettes: Bytes) -> None:
    """Marks silhouette edges: of one face only, or with both faces on one side as seen from the camera.

    Args:
        edges: of the mesh.
        eyes: (B, 3), cameras in the object's frame.
        silhouettes: (B, E), gets 1 or 0.
    """
    planes, kind = edges.planes, edges.kind
    for first in range(0, kind.size, _CACHED):
        last = min(first + _CACHED, kind.size)
        for b in range(eyes.shape[0]):
            x, y, z = eyes[b, 0], eyes[b, 1], eyes[b, 2]
            row = silhouettes[b]
            for k in range(last - first):
                e = np.uintp(first) + np.uintp(k)
                side = planes[0, 0, e] * x + planes[0, 1, e] * y + planes[0, 2, e] * z - planes[0, 3, e]
                other = planes[1, 0, e] * x + planes[1, 1, e] * y + planes[1, 2, e] * z - planes[1, 3, e]
                row[e] = (kind[e] == BOUNDARY) | (side * other >= 0)


@borrowing
def edge_crossings(
    screen: Floats,
    edges: EdgeArrays,
    silhouette: Bytes,
    candidates: Integers,
    inverse: Floats,
    crossings: Crossings,
) -> int:
    """Follows each edge sample by sample along both axes, and lists the links that it crosses where it is visible.

    An edge is visible where it lies in front of what is behind.  Of several on one link, the outermost of the nearer
    surface counts where there is a gap in depth, else the nearest.

    Args:
        screen: (V, 3), as for :func:`.rasterize.rasterize`.
        edges: of the mesh.
        silhouette: (E,), of :func:`silhouette_edges`.
        candidates: (E,), scratch.
        inverse: (H, W), 1 / depth of the samples.
        crossings: gets the links.

    Returns:
        The number of links crossed, at most N; those beyond are left out.
    """
    crossings.number[:] = 0
    count = 0
    listed = 0
    for e in range(edges.kind.size):
        candidates[np.uintp(listed)] = e
        listed += (edges.kind[e] | silhouette[e]) != 0
    for e in candidates[:listed]:
        a, b = np.uintp(edges.ends[e, 0]), np.uintp(edges.ends[e, 1])
        xa, ya, wa = screen[a, 0], screen[a, 1], screen[a, 2]
        xb, yb, wb = screen[b, 0], screen[b, 1], screen[b, 2]
        if not (wa > 0 and wb > 0):
            continue
        steep = abs(yb - ya) > abs(xb - xa)
        for axis in range(2):
            # links down are crossed at the middles of columns, links to the right at those of rows
            start, end = ((xa, ya, wa), (xb, yb, wb)) if axis == 0 else ((ya, xa, wa), (yb, xb, wb))
            measured = steep == (axis == 1)
            count = _follow_edge(e, axis, start, end, measured, silhouette[e] != 0, inverse, crossings, count)
    return count


@inlined
def _follow_edge(
    e: int,
    axis: int,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    measured: bool,
    is_silhouette: bool,
    inverse: Floats,
    crossings: Crossings,
    count: int,
) -> int:
    """Adds the crossings of one edge with the links along one axis; returns their number so far.

    ``start`` and ``end`` are (p, q, 1 / depth): p runs across the links, q along them.
    """
    real = inverse.dtype.type
    zero, half = real(0), real(0.5)
    across, along = (inverse.shape[1], inverse.shape[0]) if axis == 0 else inverse.shape
    p0, q0, w0 = start
    p1, q1, w1 = end
    if p1 < p0:
        p0, q0, w0, p1, q1, w1 = p1, q1, w1, p0, q0, w0
    beyond = real(across)
    first = int(np.ceil(min(beyond, max(zero, p0 - half))))
    last = int(np.ceil(max(zero, min(beyond, p1 - half)))) - 1
    if first > last:
        return count
    slope, deepening = (q1 - q0) / (p1 - p0), (w1 - w0) / (p1 - p0)
    q_end = real(along - 1)
    for p in range(first, last + 1):
        further = real(p) + half - p0
        q = q0 + further * slope - half
        if not (q >= 0 and q < q_end):
            continue
        k = int(q)
        w = w0 + further * deepening
        i, j = (np.uintp(k), np.uintp(p)) if axis == 0 else (np.uintp(p), np.uintp(k))
        here, there = inverse[i, j], inverse[i + np.uintp(1 - axis), j + np.uintp(axis)]
        visible, gap = _visibility(w, here, there, is_silhouette)
        if not visible:
            continue
        t = q - real(k)
        n = crossings.number[axis, i, j] - 1
        if n < 0:
            if count == crossings.link.shape[0]:
                continue
            n = count
            count += 1
            crossings.number[axis, i, j] = count
            crossings.link[n, 0], crossings.link[n, 1], crossings.link[n, 2] = axis, i, j
        elif gap:
            if (t <= crossings.values[n, AT]) if here > there else (t >= crossings.values[n, AT]):
                continue
        elif crossings.values[n, DEPTH] >= w:
            continue
        crossings.values[n, AT], crossings.values[n, SLOPE], crossings.values[n, DEPTH] = t, slope, w
        crossings.values[n, MEASURED] = real(1) if measured else zero
        crossings.edge[n] = e
    return count


@inlined
def _visibility(w: float, here: float, there: float, is_silhouette: bool) -> tuple[bool, bool]:
    """Whether an edge at 1 / depth ``w`` is visible between two samples, and whether these have a gap in depth."""
    real = type(here)
    low, high = min(here, there), max(here, there)
    gap = high - low > real(GAP) * high
    in_front = (is_silhouette and not w < real(0.5) * (low + high)) if gap else not w < real(1 - TOUCHING) * low
    return high != 0 and in_front, gap
