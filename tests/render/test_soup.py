"""Triangles of polygons cover them, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from nablahog.render.soup import MOST_CORNERS, triangulate


def _area(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vector area of a polygon (n, 3): half the sum of the cross products of its corners."""
    return np.asarray(np.cross(points, np.roll(points, -1, 0)).sum(0) / 2)


def _triangulate_one(points: NDArray[np.float64]) -> NDArray[np.int64]:
    return triangulate(points, np.arange(len(points)), np.array([len(points)]))


@given(st.lists(st.floats(0.2, 1.0), min_size=4, max_size=12), st.floats(0, 6.28), st.sampled_from([0, 1, 2]))
def test_stars_are_covered_once(radii: list[float], turn: float, axis: int) -> None:
    angles = turn + 2 * np.pi * np.arange(len(radii)) / len(radii)
    flat = np.array(radii)[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    points = np.insert(flat, axis, 0.3 * flat[:, 0] + 1, 1)  # in a plane that is not parallel to the axes
    triangles = _triangulate_one(points)
    assert len(triangles) == len(points) - 2
    areas = np.array([_area(points[corners]) for corners in triangles])
    np.testing.assert_allclose(areas.sum(0), _area(points), atol=1e-12)
    # none turns the other way, so that none covers what is outside
    np.testing.assert_allclose(np.linalg.norm(areas, axis=1).sum(), np.linalg.norm(_area(points)), rtol=1e-9)


def test_convex_polygons_are_fans_in_their_order() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 2, 0]])
    corners, counts = np.array([0, 1, 2, 0, 1, 0, 1, 2, 3, 4, 1, 2]), np.array([3, 2, 4, 3])
    triangles = triangulate(square, corners, counts)
    assert triangles.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3], [4, 1, 2]]


def test_a_hole_with_a_slit() -> None:
    outer, inner = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 3), (3, 3), (3, 1)]
    ring = np.array([*outer, outer[0], inner[0], *inner[1:], inner[0]], dtype=float)
    points = np.insert(ring, 2, 0.0, 1)
    triangles = _triangulate_one(points)
    assert sum(np.linalg.norm(_area(points[corners])) for corners in triangles) == pytest.approx(12)


def test_what_is_refused() -> None:
    with pytest.raises(ValueError, match="a vertex that the file does not hold"):
        triangulate(np.zeros((3, 3)), np.array([0, 1, 3]), np.array([3]))
    angles = np.linspace(0, 2 * np.pi, MOST_CORNERS + 2)[:-1]
    gear = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1) * (1 + np.arange(len(angles))[:, None] % 2)
    with pytest.raises(ValueError, match="at most"):
        _triangulate_one(gear)
