"""Solids: closed, of the volume that geometry says."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from nablahog.paper import solids
from nablahog.paper.solids import (
    Solid,
    bar,
    joined,
    lathe,
    loft,
    outline,
    outward,
    rounded,
    section,
    sheet,
    slab,
    tube,
)


def volume(solid: Solid) -> float:
    return abs(solids.volume(solid))


def assert_closed(solid: Solid) -> None:
    """Each edge belongs to two triangles, which run along it in opposite directions."""
    directed = Counter(map(tuple, solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()))
    assert set(directed.values()) == {1}
    assert all((b, a) in directed for a, b in directed)


def test_bar_is_a_box() -> None:
    solid = bar((1, 2, 0), (1, 2, 5), (2, 3))
    assert_closed(solid)
    assert volume(solid) == pytest.approx(30)
    np.testing.assert_allclose([solid.vertices.min(0), solid.vertices.max(0)], [[0, 0.5, 0], [2, 3.5, 5]])


@pytest.mark.parametrize(
    ("end", "extent"), [((0, 0, 9), (1, 2, 9)), ((9, 0, 0), (9, 1, 2)), ((0, 9, 0), (1, 9, 2)), ((0, 0, -9), (1, 2, 9))]
)
def test_widths_go_with_the_axes(end: tuple[float, float, float], extent: tuple[float, float, float]) -> None:
    solid = bar((0, 0, 0), end, (1, 2))
    np.testing.assert_allclose(np.ptp(solid.vertices, axis=0), extent, atol=1e-12)


def test_tapered_bar_is_a_frustum() -> None:
    assert volume(bar((0, 0, 0), (0, 0, 6), 4, 2)) == pytest.approx(6 / 3 * (16 + 8 + 4))


def test_lathe_is_round() -> None:
    solid = lathe((0, 0, 0), (0, 3, 4), [(0, 2), (0.5, 2), (1, 2)], sides=64)
    assert_closed(solid)
    assert volume(solid) == pytest.approx(np.pi * 5, rel=3e-3)


def test_closed_tube_is_a_ring() -> None:
    angle = 2 * np.pi * np.arange(48) / 48
    solid = tube(np.stack([10 * np.cos(angle), 10 * np.sin(angle), 0 * angle], axis=1), 2, sides=24, closed=True)
    assert_closed(solid)
    assert volume(solid) == pytest.approx(2 * np.pi**2 * 10, rel=0.02)


def test_bent_tube_keeps_its_thickness() -> None:
    solid = tube(rounded([(0, 0, 0), (0, 0, 20), (20, 0, 20)], 6, steps=12), 2, sides=24)
    assert_closed(solid)
    length = 14 + 14 + 6 * 1.6232  # of the parabola between two tangents of 6 at a right angle
    assert volume(solid) == pytest.approx(np.pi * length, rel=0.02)


def test_rounded_keeps_ends_and_straight_parts() -> None:
    path = rounded([(0, 0, 0), (10, 0, 0), (10, 10, 0)], 2)
    np.testing.assert_allclose(path[[0, -1]], [(0, 0, 0), (10, 10, 0)])
    np.testing.assert_allclose(path[1], (8, 0, 0))
    np.testing.assert_allclose(path[-2], (10, 2, 0))
    assert (np.abs(path - (10, 0, 0)).max(axis=1) > 0.4).all()


@pytest.mark.parametrize(("roundness", "share"), [(0.0, 0.98), (1.0, np.pi / 4)])
def test_outline_from_rectangle_to_ellipse(roundness: float, share: float) -> None:
    solid = slab(outline(10, 6, roundness=roundness, corners=128), [(0, 1), (2, 1)])
    assert_closed(solid)
    assert volume(solid) == pytest.approx(120 * share, rel=0.02)


def test_outline_is_narrower_at_the_back() -> None:
    x, y = outline(10, 10, roundness=0, taper=0.4).T
    assert x[y < -4.5].max() == pytest.approx(5, rel=0.05)
    assert x[y > 4.5].max() == pytest.approx(3, rel=0.05)


def test_sheet_has_its_thickness() -> None:
    x, z = np.meshgrid(np.linspace(0, 4, 5), np.linspace(0, 3, 4))
    solid = sheet(np.stack([x, 0 * x, z], axis=-1), 0.5)
    assert_closed(solid)
    assert volume(solid) == pytest.approx(4 * 3 * 0.5)


def test_joined_keeps_its_parts_apart() -> None:
    two = joined([bar((0, 0, 0), (0, 0, 1), 1), bar((5, 0, 0), (5, 0, 2), 1)])
    assert_closed(two)
    assert volume(two) == pytest.approx(3)


def test_loft_of_sections() -> None:
    ring = np.column_stack([section(4), np.zeros(4)])
    solid = loft(np.array([ring, ring + np.array([0, 0, 2])]))
    assert (len(solid.vertices), len(solid.faces)) == (8, 12)
    assert volume(solid) == pytest.approx(2)


def test_outward_turns_all_faces() -> None:
    for solid in (bar((0, 0, 0), (0, 0, 2), 1), lathe((0, 0, 0), (1, 2, 0), [(0, 1), (1, 2)])):
        inside_out = Solid(solid.vertices, solid.faces[:, ::-1])
        turned = [outward(each) for each in (solid, inside_out)]
        for each in turned:
            assert_closed(each)
            assert solids.volume(each) > 0
            a, b, c = (each.vertices[each.faces[:, corner]] for corner in range(3))
            away = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - each.vertices.mean(0))
            assert (away > 0).all()  # both are convex
