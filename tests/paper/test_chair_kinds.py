"""Chairs of a kind that is asked for: clean meshes, of the kind's proportions; and the library of them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch

from nablahog.paper.chairs import KINDS, LIBRARY, chair, library
from nablahog.paper.solids import Solid, volume
from nablahog.render import Mesh, depth_and_normals
from nablahog.render.camera import Camera, pose

from .test_solids import assert_closed

SEEDS = range(12)
NEW = ("swivel", "lounge", "armchair", "folding", "stool", "bench")


def _parts(mesh: Mesh) -> list[Solid]:
    """The connected parts of a mesh."""
    vertices, faces = mesh.vertices.numpy(), mesh.faces.numpy()
    label = np.arange(len(vertices))
    while True:
        lowest = label[faces].min(axis=1)
        after = label.copy()
        np.minimum.at(after, faces.reshape(-1), np.repeat(lowest, 3))
        if (after == label).all():
            break
        label = after
    return [Solid(vertices, faces[label[faces[:, 0]] == each]) for each in np.unique(label[faces[:, 0]])]


def _size(mesh: Mesh) -> tuple[float, ...]:
    """Width, depth, height."""
    return tuple((mesh.vertices.amax(0) - mesh.vertices.amin(0)).tolist())


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_and_kind_make_the_same_chair(kind: str) -> None:
    one, same, other = chair(3, kind), chair(3, kind), chair(4, kind)
    for name in ("vertices", "faces", "brightness"):
        assert torch.equal(getattr(one, name), getattr(same, name))
    assert one.vertices.shape != other.vertices.shape or not torch.equal(one.vertices, other.vertices)


@pytest.mark.parametrize("kind", KINDS)
def test_clean_meshes(kind: str) -> None:
    """Closed solids whose faces turn outwards; none without an area."""
    for seed in SEEDS:
        mesh = chair(seed, kind)
        assert 90 <= len(mesh.faces) <= 10_000
        a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
        areas = torch.linalg.cross(b - a, c - a).norm(dim=1) / 2
        assert float(areas.min()) > 1e-8, seed
        parts = _parts(mesh)
        assert len(parts) >= 2
        for part in parts:
            assert_closed(part)
            assert volume(part) > 0, seed
        low, high = mesh.vertices.amin(0), mesh.vertices.amax(0)
        torch.testing.assert_close(low, -high)
        assert float((high - low).norm()) == pytest.approx(1)


@pytest.mark.parametrize("kind", [kind for kind in NEW if kind not in ("stool", "bench")])
def test_backs_are_behind(kind: str) -> None:
    for seed in SEEDS:
        mesh = chair(seed, kind)
        top = mesh.vertices[mesh.vertices[:, 2] > 0.42 * _size(mesh)[2]]
        assert float(top[:, 1].mean()) > 0.05, seed


@pytest.mark.parametrize("kind", NEW)
def test_what_is_below_stands_on_the_floor(kind: str) -> None:
    for seed in SEEDS:
        mesh = chair(seed, kind)
        low = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.02]
        assert (low.amax(0) - low.amin(0))[:2].min() > 0.12, seed


@pytest.mark.parametrize(
    ("kind", "width", "depth", "height"),
    [
        ("swivel", (0.35, 0.6), (0.4, 0.6), (0.6, 0.85)),
        ("lounge", (0.4, 0.65), (0.55, 0.75), (0.45, 0.7)),
        ("armchair", (0.4, 0.65), (0.4, 0.65), (0.5, 0.75)),
        ("folding", (0.35, 0.6), (0.3, 0.6), (0.7, 0.85)),
        ("stool", (0.3, 0.65), (0.3, 0.65), (0.5, 0.9)),
        ("bench", (0.65, 0.97), (0.18, 0.45), (0.2, 0.65)),
    ],
)
def test_proportions(
    kind: str, width: tuple[float, float], depth: tuple[float, float], height: tuple[float, float]
) -> None:
    for seed in SEEDS:
        for side, (low, high) in zip(_size(chair(seed, kind)), (width, depth, height), strict=True):
            assert low < side < high, seed


def test_stools_are_flat_and_alike_from_front_and_behind() -> None:
    for seed in SEEDS:
        mesh = chair(seed, "stool")
        top = mesh.vertices[mesh.vertices[:, 2] > 0.4 * _size(mesh)[2]]
        assert abs(float(top[:, 1].mean())) < 0.02
        depth, _ = depth_and_normals(mesh, pose(0, 90, 10), Camera(200.0, 21, 21))
        assert 10 - float(depth[0, 10, 10]) == pytest.approx(_size(mesh)[2] / 2, abs=0.03)  # the seat is on top


def test_swivel_chairs_have_five_arms_with_castors() -> None:
    mesh = chair(0, "swivel")
    low = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.03].numpy()
    angles = np.sort(np.degrees(np.arctan2(low[:, 1], low[:, 0])) % 360)
    gaps = np.diff([*angles, angles[0] + 360])
    assert (gaps > 40).sum() == 5


def test_library() -> None:
    models, again = library(), library()
    assert list(models) == [f"{kind}-{seed}" for kind, seed in LIBRARY]
    assert 36 <= len(models) <= 48
    assert set(Counter(kind for kind, _ in LIBRARY)) == set(KINDS)
    assert all(torch.equal(models[name].vertices, again[name].vertices) for name in models)
    assert torch.equal(models["swivel-2"].vertices, chair(2, "swivel").vertices)
