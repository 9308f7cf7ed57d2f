"""Meshes with fewer faces: nothing moves farther than allowed, and pictures stay what they were."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import native
from nablahog.render import Camera, Mesh, render
from nablahog.render.surface import collapse_edges, simplify

from ..chairs import chair
from .shapes import box, cylinder, joined, poses

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
