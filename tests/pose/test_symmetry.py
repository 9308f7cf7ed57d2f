"""Where no photograph tells the azimuth."""

from __future__ import annotations

import numpy as np
import torch

from nablahog.pose import estimate_pose
from nablahog.pose.crop import typical_camera
from nablahog.pose.prepared import prepared_model
from nablahog.pose.symmetry import equivalent_azimuths
from nablahog.render import Mesh

from .common import degrees_between, model, photographed


def bottle(sides: int = 32) -> Mesh:
    """A solid of revolution."""
    profile = [(0.0, -0.45), (0.12, -0.45), (0.12, 0.1), (0.04, 0.25), (0.04, 0.45), (0.0, 0.45)]
    turns = 2 * np.pi * np.arange(sides) / sides
    rings = [np.stack([r * np.cos(turns), r * np.sin(turns), np.full(sides, z)], 1) for r, z in profile]
    faces = []
    for ring in range(len(profile) - 1):
        for k in range(sides):
            a, b = ring * sides + k, ring * sides + (k + 1) % sides
            faces += [[a, b, b + sides], [a, b + sides, a + sides]]
    vertices = torch.from_numpy(np.concatenate(rings))
    return Mesh(vertices, torch.tensor(faces), torch.full((len(vertices),), 0.6, dtype=torch.float64))


def slab() -> Mesh:
    """A cuboid, which looks the same from behind."""
    vertices = torch.cartesian_prod(*(torch.tensor([-side, side]).double() for side in (0.4, 0.2, 0.25)))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))]
    return Mesh(vertices, torch.tensor(faces), torch.full((8,), 0.6, dtype=torch.float64))


def test_azimuths_from_which_a_model_looks_the_same() -> None:
    camera = typical_camera()
    assert len(equivalent_azimuths(prepared_model(bottle(), camera), 10, 15)) == 47
    assert equivalent_azimuths(prepared_model(slab(), camera), 20, 15) == (200,)
    assert equivalent_azimuths(prepared_model(model(), camera), 20, 15) == ()


def test_a_bottle_has_any_azimuth() -> None:
    image, box = photographed(bottle(), 30, 15, behind="coffee")
    estimate = estimate_pose(image, bottle(), box=box, initial=(0, 15))
    assert estimate.any_azimuth
    assert estimate.runners_up == ()
    assert "azimuth any" in repr(estimate)


def test_the_back_of_a_slab_is_no_other_pose() -> None:
    image, box = photographed(slab(), 30, 15, behind="coffee")
    estimate = estimate_pose(image, slab(), box=box, initial=(0, 15))
    assert not estimate.any_azimuth
    (other,) = estimate.equivalent_azimuths
    assert degrees_between(other, estimate.azimuth) == 180
    assert min(degrees_between(estimate.azimuth, each) for each in (30, 210)) < 4
    assert all(min(degrees_between(float(one.pose[0]), each) for each in (30, 210)) > 15 for one in estimate.runners_up)
