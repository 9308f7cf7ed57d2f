"""Simple triangulated solids, the parts of procedural objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Generator = np.random.Generator


class Solid(NamedTuple):
    """Vertices (V, 3), float64, and faces (F, 3), int64."""

    vertices: Floats
    faces: NDArray[np.int64]


Parts: TypeAlias = tuple[list[Solid], list[Solid]]
"""The solids of an object by their tone: frame and cover."""


def joined(solids: Iterable[Solid]) -> Solid:
    """All triangles of several solids, which may overlap."""
    parts = list(solids)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    return Solid(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def volume(solid: Solid) -> float:
    """By the divergence theorem, of a closed solid; below 0 where its faces turn inwards."""
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def outward(solid: Solid) -> Solid:
    """The closed solid with the corners of its faces counter-clockwise as seen from outside."""
    return solid if volume(solid) >= 0 else Solid(solid.vertices, solid.faces[:, ::-1])


def moved(solid: Solid, by: ArrayLike) -> Solid:
    """The solid somewhere else."""
    return Solid(solid.vertices + np.asarray(by, dtype=np.float64), solid.faces)


def loft(rings: Floats, *, closed: bool = False) -> Solid:
    """The surface through successive rings of points, with lids on the first and the last.

    Args:
        rings: (R, N, 3); N is even, and the points i and N-1-i of a ring are opposite each other: the lids are made of
            quadrilaterals between them.
        closed: the last ring is followed by the first, and there are no lids.
    """
    count, corners = rings.shape[:2]
    index = np.arange(count * corners).reshape(count, corners)
    if closed:
        index = np.concatenate([index, index[:1]])
    right = np.roll(index, -1, axis=1)
    quads = [np.stack([index[:-1], right[:-1], right[1:], index[1:]], axis=-1).reshape(-1, 4)]
    if not closed:
        half = np.arange(corners // 2 - 1)
        lid = np.stack([half, corners - 1 - half, corners - 2 - half, half + 1], axis=-1)
        quads += [index[0][lid], index[-1][lid[:, ::-1]]]
    four = np.concatenate(quads)
    return Solid(rings.reshape(-1, 3), np.concatenate([four[:, [0, 1, 2]], four[:, [0, 2, 3]]]))


def section(sides: int) -> Floats:
    """(N, 2): a square of side 1 for four sides, or else a circle of diameter 1, as a ring of :func:`loft`."""
    if sides == 4:
        return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def tube(path: ArrayLike, size: ArrayLike, *, sides: int = 8, closed: bool = False) -> Solid:
    """A bar along a path.

    Args:
        path: (K, 3).
        size: its width and depth: one number, (K,) where they are the same, or (1, 2) or (K, 2).  For upright bars the
            first is along x and the second along y; for bars along x, along y and z; for bars along y, along x and z.
        sides: 4 makes it square, others round.
        closed: the path ends where it begins, without repeating the point.
    """
    points = np.asarray(path, dtype=np.float64)
    sizes = np.asarray(size, dtype=np.float64)
    sizes = np.broadcast_to(sizes[:, None] if sizes.ndim == 1 else sizes, (len(points), 2))
    around = np.concatenate([points[-1:], points, points[:1]]) if closed else np.pad(points, ((1, 1), (0, 0)), "edge")
    tangents = _unit(around[2:] - around[:-2])
    side = np.eye(3)[1 if abs(tangents[0, 0]) > 0.9 else 0]
    rings = []
    for point, tangent, (width, depth) in zip(points, tangents, sizes, strict=True):
        side = _unit(side - (side @ tangent) * tangent)
        across = section(sides) * (width, depth)
        rings.append(point + across @ np.stack([side, np.cross(tangent, side)]))
    return loft(np.array(rings), closed=closed)


def bar(
    start: ArrayLike, end: ArrayLike, size: ArrayLike, end_size: ArrayLike | None = None, *, sides: int = 4
) -> Solid:
    """A straight bar from ``start`` to ``end``, (3,), whose sizes there are one number or (2,) as in :func:`tube`."""
    sizes = [np.broadcast_to(size, 2), np.broadcast_to(size if end_size is None else end_size, 2)]
    return tube(np.array([start, end], dtype=np.float64), np.array(sizes), sides=sides)


def lathe(start: ArrayLike, end: ArrayLike, profile: Sequence[tuple[float, float]], *, sides: int = 12) -> Solid:
    """A solid of revolution from ``start`` to ``end``; ``profile`` has diameters at positions 0…1 between them."""
    share, diameter = np.array(profile).T
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    return tube(first + share[:, None] * (last - first), np.stack([diameter, diameter], axis=1), sides=sides)


def rounded(corners: ArrayLike, radius: float, *, steps: int = 4) -> Floats:
    """The open polyline ``corners`` (K, 3), its inner corners replaced by curves that start ``radius`` before them."""
    points = np.asarray(corners, dtype=np.float64)
    path = [points[:1]]
    t = np.linspace(0, 1, steps + 1)[:, None]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        a, b = (corner + _unit(other - corner) * min(radius, _half(other, corner)) for other in (before, after))
        path.append((1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b)
    return np.concatenate([*path, points[-1:]])


def outline(width: float, depth: float, *, roundness: float, taper: float = 0.0, corners: int = 32) -> Floats:
    """(N, 2): a superellipse, from a rectangle (``roundness`` 0) to an ellipse (1), centred at 0.

    ``taper`` is the relative difference of width between front and back (+y).
    """
    angle = 2 * np.pi * (np.arange(corners) + 0.5) / corners
    power = np.exp(np.log(0.08) * (1 - roundness))  # 2 / the exponent
    x, y = (np.sign(f) * np.abs(f) ** power / 2 for f in (np.cos(angle), np.sin(angle)))
    return np.stack([width * x * (1 - taper * (y + 0.5)), depth * y], axis=-1)


def slab(shape: Floats, levels: Sequence[tuple[float, float]]) -> Solid:
    """A lying solid of outline ``shape`` (N, 2), scaled by a factor at each height: (z, factor)."""
    rings = [np.column_stack([shape * share, np.full(len(shape), z)]) for z, share in levels]
    return loft(np.array(rings))


def sheet(surface: Floats, thickness: ArrayLike) -> Solid:
    """A curved board: ``surface`` (R, C, 3) is its middle surface, ``thickness`` one number or (R, C)."""
    along, across = np.gradient(surface, axis=0), np.gradient(surface, axis=1)
    offset = _unit(np.cross(along, across)) * (np.broadcast_to(thickness, surface.shape[:2])[..., None] / 2)
    return loft(np.concatenate([surface + offset, (surface - offset)[:, ::-1]], axis=1))


def _unit(vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: Floats = vectors / np.maximum(lengths, 1e-12)
    return unit


def _half(a: Floats, b: Floats) -> float:
    return float(np.linalg.norm(a - b)) / 2
