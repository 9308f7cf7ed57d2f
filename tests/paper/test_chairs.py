"""Procedural chairs: the same for the same seed, many kinds, all of them chairs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from nablahog.paper import chair_backs, chair_legs, chairs
from nablahog.paper.chairs import chair
from nablahog.paper.solids import Solid, joined
from nablahog.render import Mesh, depth_and_normals
from nablahog.render.camera import Camera, pose

from .test_solids import assert_closed

SEEDS = range(60)


@pytest.fixture(scope="module")
def fleet() -> list[Mesh]:
    return [chair(seed) for seed in SEEDS]


def test_the_same_seed_makes_the_same_chair() -> None:
    a, b, other = chair(3), chair(3), chair(4)
    assert torch.equal(a.vertices, b.vertices)
    assert torch.equal(a.faces, b.faces)
    assert torch.equal(a.brightness, b.brightness)
    assert a.vertices.shape != other.vertices.shape or not torch.equal(a.vertices, other.vertices)


def test_chairs_stay_what_they_are() -> None:
    """Figures of the benchmark are only comparable if its models never change."""
    expected = [
        [1932, 0.432, 0.486, 0.760, 0.623],
        [1768, 0.467, 0.450, 0.761, 0.934],
        [2704, 0.522, 0.572, 0.632, 0.765],
        [2108, 0.395, 0.413, 0.821, 0.778],
    ]
    result = [
        [len(mesh.faces), *(mesh.vertices.amax(0) - mesh.vertices.amin(0)).tolist(), float(mesh.brightness[0])]
        for mesh in map(chair, (0, 1, 9, 22))
    ]
    np.testing.assert_allclose(result, expected, atol=1e-3)


def test_all_differ(fleet: list[Mesh]) -> None:
    extents = {tuple((mesh.vertices.amax(0) * 1e6).round().tolist()) for mesh in fleet}
    assert len(extents) == len(fleet)


def test_normalized_of_moderate_size_and_two_tones(fleet: list[Mesh]) -> None:
    for mesh in fleet:
        low, high = mesh.vertices.amin(0), mesh.vertices.amax(0)
        torch.testing.assert_close(low, -high)
        assert float((high - low).norm()) == pytest.approx(1)
        assert 300 <= len(mesh.faces) <= 10_000
        assert len(mesh.brightness.unique()) <= 2


def test_proportions_are_those_of_chairs(fleet: list[Mesh]) -> None:
    for mesh in fleet:
        width, depth, height = (mesh.vertices.amax(0) - mesh.vertices.amin(0)).tolist()
        assert 0.6 < height / width < 2.8
        assert 0.6 < depth / width < 1.7


def test_backs_are_behind_and_seats_in_the_middle(fleet: list[Mesh]) -> None:
    for seed, mesh in zip(SEEDS, fleet, strict=True):
        height = float(mesh.vertices[:, 2].max()) * 2
        top = mesh.vertices[mesh.vertices[:, 2] > 0.42 * height]
        assert float(top[:, 1].mean()) > 0.05, seed
        # a camera far above the middle of the front half sees the seat
        depth, _ = depth_and_normals(mesh, pose(0, 90, 10), Camera(200.0, 21, 21))
        seat = (10 - float(depth[0, 12, 10])) / height + 0.5
        assert 0.3 < seat < 0.72, seed


def test_chairs_stand_on_a_wide_foot(fleet: list[Mesh]) -> None:
    for seed, mesh in zip(SEEDS, fleet, strict=True):
        low = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.02]
        extent = low.amax(0) - low.amin(0)
        assert extent[:2].min() > 0.15, seed


@pytest.mark.parametrize("kind", list(chairs._KINDS))
def test_every_kind_is_made_of_closed_parts(kind: str) -> None:
    for seed in range(4):
        frame, cover = chairs._KINDS[kind][1](np.random.default_rng(seed))
        assert frame
        assert cover
        for part in frame + cover:
            assert_closed(part)
            assert np.isfinite(part.vertices).all()
            assert part.vertices[:, 2].min() > -1.5  # a bar that leans may reach below the floor by its thickness


@pytest.mark.parametrize("style", chair_backs.STYLES.values(), ids=list(chair_backs.STYLES))
def test_backs_have_their_height(style: Callable[[chair_backs.Back, np.random.Generator], list[Solid]]) -> None:
    back = chair_backs.Back(40, 50, 20, 45, tilt=0.0, curve=3, bend=0, spread=0)
    for seed in range(5):
        vertices = joined(style(back, np.random.default_rng(seed))).vertices
        assert vertices[:, 2].max() == pytest.approx(95, abs=4)
        assert np.ptp(vertices[:, 0]) > 30
        assert vertices[:, 1].max() < 30


@pytest.mark.parametrize("kind", ["straight", "tapered", "splayed", "turned", "sabre", "hairpin"])
def test_four_legs_reach_from_floor_to_seat(kind: str) -> None:
    tops = chair_legs.corners(45, 42, 3, 4)
    vertices = joined(chair_legs.feet(tops, 44, kind, np.random.default_rng(0))).vertices
    assert vertices[:, 2].min() == pytest.approx(0, abs=1)
    assert vertices[:, 2].max() == pytest.approx(44, abs=1)
    for x, y in tops:
        assert np.linalg.norm(vertices - (x, y, 44), axis=1).min() < 5


def test_what_is_no_chair_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 0, got -1"):
        chair(-1)
    with pytest.raises(ValueError, match=r"kind must be one of wooden, .*, bench, got 'sofa'"):
        chair(0, "sofa")
