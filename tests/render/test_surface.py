"""The surface of meshes: edges, smooth corners, brightness under a light, and meshes with fewer faces."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import native
from nablahog.render import Camera, Light, Mesh, render
from nablahog.render.surface import (
    BOUNDARY,
    CREASE,
    SMOOTH,
    Edges,
    collapse_edges,
    corner_brightness,
    corner_normals,
    mesh_edges,
    simplify,
    smoothing_groups,
)

from ..chairs import chair
from .shapes import box, cylinder, flipped, joined, mesh, poses, quads, split

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
def test_neither_the_order_of_corners_nor_vertices_split_by_colour_matter(one: Mesh) -> None:
    turned, apart = flipped(one), split(one)
    for other in (turned, apart):
        assert places(other, mesh_edges(other)) == places(one, mesh_edges(one))
    assert {(c // 3, f) for c, f in joins(turned)} == {(c // 3, f) for c, f in joins(one)}
    assert joins(apart) == joins(one)


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


LIGHT = Light((1, -2, 3), 0.3, 0.7)


def shaded(one: Mesh, light: Light = LIGHT) -> Tensor:
    return corner_brightness(one, smoothing_groups(one), light)


@pytest.mark.slow
def test_the_sides_of_a_box() -> None:
    """Opposite sides alike: |n·l|.  The default light tells all three apart."""
    length = math.sqrt(1 + 4 + 9)
    for brightness in (1.0, 0.5):
        result = shaded(box((1, 2, 3), brightness))
        for k, along in enumerate((1, 2, 3)):  # four triangles of each pair of sides
            expected = torch.full((4, 3), brightness * (0.3 + 0.7 * along / length), dtype=torch.float64)
            assert_close(result[4 * k : 4 * k + 4], expected)


def test_smooth_sides_and_sharp_rims() -> None:
    one = cylinder(24)
    normals = corner_normals(one, smoothing_groups(one))
    at = one.vertices[one.faces]
    sides = at[..., 2].std(1) > 0
    radial = at * torch.tensor([2.0, 2, 0])
    assert_close((normals * radial).sum(2).abs()[sides], torch.ones(48, 3, dtype=torch.float64), rtol=0, atol=1e-2)
    assert_close(normals[~sides].abs(), torch.tensor([0.0, 0, 1], dtype=torch.float64).expand(44, 3, 3))
    # the side's two triangles weigh 2 : 1 or 1 : 2 in a corner, so that it is not exactly between both sides
    assert (normals * radial).sum(2).abs()[sides].min() > math.cos(math.radians(15 / 4))


@pytest.mark.slow
def test_derivatives() -> None:
    one = cylinder(9)
    smooth = smoothing_groups(one)

    def brightness(vertices: Tensor, albedo: Tensor) -> Tensor:
        return corner_brightness(Mesh(vertices, one.faces, albedo), smooth, LIGHT)

    inputs = one.vertices.clone().requires_grad_(), one.brightness.clone().requires_grad_()
    assert torch.autograd.gradcheck(brightness, inputs, check_forward_ad=True)


def test_no_light() -> None:
    for direction, ambient, diffuse in (((0, 0, 0), 0.3, 0.7), ((1, 2, 3), -0.1, 0.5), ((1, 2, 3), 0.6, 0.6)):
        with pytest.raises(ValueError, match="light"):
            Light(direction, ambient, diffuse)


REACH = 0.02
MESHES = {"round": joined(cylinder(200), box((1.5, 0.2, 0.3))).normalized(), "chair": chair(2)}
meshes = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())


def nearest(points: Tensor, others: Tensor) -> Tensor:
    return torch.cdist(points, others, compute_mode="donot_use_mm_for_euclid_dist").amin(1)


@meshes
def test_no_vertex_moves_too_far(mesh: Mesh) -> None:
    result = simplify(mesh, REACH)
    assert 0 < len(result.faces) < 0.8 * len(mesh.faces)
    assert (nearest(result.vertices, mesh.vertices) == 0).all()  # those that are left have not moved
    assert nearest(mesh.vertices, result.vertices).max() <= REACH
    a, b, c = result.faces.T
    assert ((a != b) & (b != c) & (c != a)).all()
    assert len(result.faces.sort(1).values.unique(dim=0)) == len(result.faces)


def test_a_mesh_that_would_lose_all_faces_stays_as_it_is() -> None:
    assert simplify(MESHES["chair"], 10.0) is MESHES["chair"]


@meshes
def test_pictures_stay_alike(mesh: Mesh) -> None:
    """At 100 pixels an object, two pixels are 0.02."""
    camera = Camera(260, 96, 96)
    where = poses(4, 2.6)
    before, after = (render(each, where, camera) for each in (mesh, simplify(mesh, REACH / 4)))
    assert ((before - after).abs() > 0.1).float().mean() < 0.02
    assert (before < 0.9).float().mean() > 0.1


def test_loops_and_plain_python_merge_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(0)
    places, ends = generator.normal(size=(300, 3)), generator.integers(300, size=(900, 2))
    result = collapse_edges(places, ends, 1.5)
    assert 5 < len(np.unique(result)) < 250
    monkeypatch.setattr(native, "library", lambda: None)
    np.testing.assert_array_equal(collapse_edges(places, ends, 1.5), result)


def test_triangles_of_no_area_are_dark_and_harmless() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], dtype=torch.float64, requires_grad=True)
    one = Mesh(vertices, torch.tensor([[0, 1, 2], [0, 1, 3], [1, 1, 3]]), torch.ones(4, dtype=torch.float64))
    result = shaded(one)
    assert_close(result[[0, 2]], torch.full((2, 3), 0.3, dtype=torch.float64))
    (slope,) = torch.autograd.grad(result.sum(), vertices)
    assert torch.isfinite(slope).all()
