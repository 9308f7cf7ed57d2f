"""Edges and smooth corners of meshes: proper ones, open, non-manifold, degenerate, and with split vertices."""

from __future__ import annotations

import itertools
import math

import pytest
import torch

from nablahog.render import Mesh
from nablahog.render.surface import BOUNDARY, CREASE, SMOOTH, Edges, mesh_edges, smoothing_groups

from .shapes import box, cylinder, flipped, mesh, quads, split

TETRAHEDRON = mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])


def places(one: Mesh, result: Edges) -> dict[frozenset[tuple[float, ...]], int]:
    """The kind of each edge by where its ends are."""
    ends = one.vertices[result.ends].tolist()
    return {frozenset(map(tuple, pair)): kind for pair, kind in zip(ends, result.kind.tolist(), strict=True)}


def joins(one: Mesh) -> set[tuple[int, int]]:
    """Which face's normal counts at which corner."""
    result = smoothing_groups(one)
    return set(zip(result.corner.tolist(), result.face.tolist(), strict=True))


def sheet(size: int) -> Mesh:
    """size x size squares on a hill that is nowhere steep."""
    steps = [k / size - 0.5 for k in range(size + 1)]
    vertices = [(x, y, 0.1 * math.cos(2 * x + 0.3) * math.cos(2 * y - 0.2)) for x in steps for y in steps]
    row = size + 1
    faces = [(row * i + j, row * i + j + 1, row * i + row + j + 1, row * i + row + j)
             for i in range(size) for j in range(size)]  # fmt: skip
    return mesh(vertices, quads(faces))


def test_a_cube_has_twelve_edges() -> None:
    cube = box()
    result = mesh_edges(cube)
    expected = {
        frozenset((a, b))
        for a, b in itertools.combinations(map(tuple, cube.vertices.tolist()), 2)
        if math.dist(a, b) == pytest.approx(1)
    }
    assert places(cube, result) == dict.fromkeys(expected, CREASE)


def test_three_faces_at_an_edge() -> None:
    fins = mesh([(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)], [(0, 1, 2), (1, 0, 3), (0, 1, 4)])
    result = places(fins, mesh_edges(fins))
    assert len(result) == 7
    assert set(result.values()) == {BOUNDARY}


@pytest.mark.parametrize("one", [box(), cylinder(12), TETRAHEDRON, sheet(4)], ids=["box", "prism", "4 faces", "sheet"])
def test_the_order_of_corners_does_not_matter(one: Mesh) -> None:
    other = flipped(one)
    assert places(other, mesh_edges(other)) == places(one, mesh_edges(one))
    assert {(c // 3, f) for c, f in joins(other)} == {(c // 3, f) for c, f in joins(one)}


@pytest.mark.parametrize("one", [box(), cylinder(12), TETRAHEDRON, sheet(4)], ids=["box", "prism", "4 faces", "sheet"])
def test_vertices_split_by_colour_are_one(one: Mesh) -> None:
    other = split(one)
    assert places(other, mesh_edges(other)) == places(one, mesh_edges(one))
    assert joins(other) == joins(one)


@pytest.mark.parametrize(("sides", "kind"), [(8, CREASE), (11, CREASE), (12, SMOOTH), (32, SMOOTH)])
def test_creases_are_where_faces_meet_at_more_than_30_degrees(sides: int, kind: int) -> None:
    """At twelve sides it is 30 exactly, whatever the rounding."""
    tube = cylinder(sides, caps=False)
    result = mesh_edges(tube)
    assert result.kind[result.kind != BOUNDARY].tolist() == [kind] * sides
    # one side has two triangles at each vertex, the other side one: all of them join, or each side's own
    assert len(joins(tube)) == 2 * sides * (3 * 3 if kind == SMOOTH else 2 * 2 + 1)


def test_a_crowded_vertex_is_no_hang() -> None:
    """A fan of 100 000 triangles: pairs of these would be 10 000 000 000."""
    count = 100_000
    angle = torch.linspace(0, 2 * math.pi, count + 1, dtype=torch.float64)[:-1]
    rim = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], dim=1)
    around = torch.arange(1, count + 1)
    faces = torch.stack([torch.zeros_like(around), around, around.roll(-1)], dim=1)
    fan = mesh(torch.cat([torch.tensor([[0.0, 0, 1]], dtype=torch.float64), rim]), faces)
    assert int((mesh_edges(fan).kind == BOUNDARY).sum()) == count
    result = smoothing_groups(fan)
    at_tip = result.corner % 3 == 0
    assert at_tip.sum() == count  # each alone; on the rim two meet
    assert len(result.corner) == count + 4 * count
