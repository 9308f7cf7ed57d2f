"""The covariance of a pose: from a known curvature, in the photograph and in space, and on scenes of known poses."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import estimate_pose, sample_chairs
from nablahog.inputs.boxes import Box
from nablahog.io.images import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import rotation_error
from nablahog.paper.annotations import sample_viewpoints
from nablahog.paper.scenes import Scene, scene
from nablahog.pose import PoseEstimate
from nablahog.pose.ascent import UNITS
from nablahog.pose.covariance import ASSUMED_FOCAL, KNOWN_FOCAL, Scales, pose_covariance
from nablahog.pose.crop import ObjectCrop, crop_object
from nablahog.pose.problem import wrap_angles, wrap_hessian
from nablahog.render import Camera

PHOTO = torch.rand(3, 200, 240, generator=torch.Generator().manual_seed(0))
BOX = (120.0, 30.0, 190.0, 110.0)
IN_CROP = torch.tensor([40.0, 20, 3, 5, 6, -4], dtype=torch.float64)
CAMERA = Camera(250.0, 200, 240)
SIMILARITY = 12.0


def curvature(seed: int = 0) -> Tensor:
    """(6, 6), positive definite, in the units of the ascent."""
    mixed = torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return torch.eye(6, dtype=torch.float64) + 0.1 * mixed @ mixed.T


def crop(*, known: bool) -> ObjectCrop:
    return crop_object(PHOTO, BOX, focal=250.0 if known else None, axis=(125.0, 90.0) if known else None)


def covariance(bend: Tensor, place: ObjectCrop, *, any_azimuth: bool = False) -> Tensor:
    return pose_covariance(
        SIMILARITY, -bend / torch.outer(UNITS, UNITS), IN_CROP, place, (200, 240), any_azimuth=any_azimuth
    )


def scaled_inverse(bend: Tensor, scales: Scales, far: float = 1.0) -> Tensor:
    """The covariance in the crop in its units, by hand; ``far`` is a further factor of the distance's deviation."""
    factors = scales.factors.clone()
    factors[2] *= far
    return torch.outer(factors, factors) * torch.linalg.inv(SIMILARITY * bend) + torch.diag(scales.floors**2)


def central_slopes(function: Callable[[Tensor], Tensor], at: Tensor, size: float = 1e-3) -> Tensor:
    """The Jacobian by differences."""
    steps = size * torch.eye(len(at), dtype=torch.float64)
    return torch.stack([(function(at + step) - function(at - step)) / (2 * size) for step in steps], 1)


def test_it_is_the_scaled_inverse_of_the_curvature() -> None:
    """Where the focal length is assumed, the photograph differs from the crop by its zoom alone."""
    place, bend = crop(known=False), curvature()
    expected = torch.outer(UNITS, UNITS) * scaled_inverse(bend, ASSUMED_FOCAL)
    zoom = torch.tensor([1, 1, 1, 1, 1 / place.zoom, 1 / place.zoom], dtype=torch.float64)
    expected = expected * torch.outer(zoom, zoom)
    output, others = covariance(bend, place), [0, 1, 3, 4, 5]
    assert_close(output[others][:, others], expected[others][:, others])
    assert output[2, 2] == math.inf
    assert not output[2, others].any()
    assert not output[others, 2].any()


@pytest.mark.parametrize("times", [0.5, 1, 2])
def test_it_is_that_of_poses_moved_to_the_photograph(times: float) -> None:
    """Beyond the usual distance its deviation by the curvature grows with a power of it, its floor with itself."""
    pose, place, bend = IN_CROP.clone(), crop(known=True), curvature(1)
    pose[2] *= times
    units = UNITS.clone()
    units[2] *= times
    in_crop = torch.outer(units, units) * scaled_inverse(bend, KNOWN_FOCAL, max(times, 1) ** 0.7)
    slopes = central_slopes(lambda pose: place.place_in_photograph(pose, 200, 240)[0], pose)
    expected = slopes @ in_crop @ slopes.T
    output = pose_covariance(SIMILARITY, -bend / torch.outer(units, units), pose, place, (200, 240), any_azimuth=False)
    deviations = expected.diagonal().sqrt()
    scale = torch.outer(deviations, deviations)
    assert_close(output / scale, expected / scale, rtol=0, atol=1e-3)


def test_seen_from_above_a_turn_that_a_tilt_undoes_is_uncertain() -> None:
    """Along it the rotation hardly changes."""
    pose, place, bend = IN_CROP.clone(), crop(known=True), curvature()
    turn = torch.tensor([1.0, 0, 0, math.sin(math.radians(80)), 0, 0], dtype=torch.float64)
    pose[1] = 80
    moved = pose + 5 * turn
    assert float(rotation_error(moved[[0, 1, 3]].numpy(), pose[[0, 1, 3]].numpy())) < 1
    hessian = -bend / torch.outer(UNITS, UNITS)
    above = pose_covariance(SIMILARITY, hessian, pose, place, (200, 240), any_azimuth=False)
    pose[1] = 45
    level = pose_covariance(SIMILARITY, hessian, pose, place, (200, 240), any_azimuth=False)
    excess = 2 * (math.tan(math.radians(80)) ** 2 - 1) * level[1, 1]
    angles = [0, 1, 3]
    expected = (level + excess * torch.outer(turn, turn))[angles][:, angles]
    assert_close(above[angles][:, angles], expected)


def test_no_photograph_tells_the_azimuth_of_a_bottle() -> None:
    output = covariance(curvature(), crop(known=True), any_azimuth=True)
    assert output[0, 0] == math.inf
    assert not output[0, 1:].any()
    assert_close(output[1:, 1:], covariance(curvature(), crop(known=True))[1:, 1:])


@pytest.mark.parametrize("bend", [-torch.eye(6), torch.zeros(6, 6), torch.diag(torch.tensor([1.0, 1e-9, 1, 0, 1, 1]))])
def test_any_curvature_has_a_finite_positive_covariance(bend: Tensor) -> None:
    output = covariance(bend.double(), crop(known=True))
    assert output.isfinite().all()
    assert (torch.linalg.eigvalsh(output) > 0).all()
    assert_close(output, output.T)


@pytest.mark.parametrize("elevation", [20.0, 110.0, -100.0, 350.0])
def test_a_hessian_is_turned_with_the_angles(elevation: float) -> None:
    pose = torch.tensor([40.0, elevation, 3, 5, 6, -4], dtype=torch.float64)
    steps = torch.eye(6, dtype=torch.float64)
    slopes = torch.stack([wrap_angles(pose + step) - wrap_angles(pose) for step in steps], 1)
    bend = curvature(5)
    assert_close(wrap_hessian(bend, pose), torch.linalg.inv(slopes).T @ bend @ torch.linalg.inv(slopes))


def estimate(unit: float = 1.0) -> PoseEstimate:
    """A pose with a covariance, of a mesh whose file has ``unit`` for each of its units."""
    from_original = torch.diag(torch.tensor([1 / unit] * 3 + [1], dtype=torch.float64))
    plain = PoseEstimate(30, 10, 2.5, 4, 31, -22.5, CAMERA, "", 9.0, "calibrated", torch.zeros(6), 100, Box(0, 0, 9, 9))
    bend = curvature(3)
    known = {"covariance": covariance(bend, crop(known=True)), "principal_point": (125.0, 90.0)}
    return replace(plain, from_original=from_original, **known)


def test_the_position_is_where_the_matrix_puts_the_middle() -> None:
    one = estimate(1300)
    assert_close(one.position, one.matrix()[:3, 3])  # the file's origin is the middle
    assert float(one.position.norm()) == pytest.approx(one.distance_in_file_units)


def test_standard_deviations_of_the_position_are_those_of_moved_poses() -> None:
    one = estimate(1300)
    assert one.covariance is not None
    assert one.position_std is not None

    def position(place: Tensor) -> Tensor:
        distance, x, y = place.tolist()
        return replace(one, distance=distance, x=x, y=y).position

    slopes = central_slopes(position, torch.tensor([one.distance, one.x, one.y], dtype=torch.float64))
    moved = slopes @ one.covariance[[2, 4, 5]][:, [2, 4, 5]] @ slopes.T
    assert_close(one.position_std, moved.diagonal().sqrt(), rtol=1e-3, atol=0)


def test_units_of_the_file() -> None:
    one = estimate(1300)
    assert one.covariance is not None
    assert one.covariance_in_file_units is not None
    assert_close(one.covariance_in_file_units[2, 2], 1300**2 * one.covariance[2, 2])
    assert_close(one.covariance_in_file_units[2, 4], 1300 * one.covariance[2, 4])
    assert_close(one.covariance_in_file_units[0, 4], one.covariance[0, 4])
    assert replace(one, covariance=None).covariance_in_file_units is None


@pytest.mark.parametrize("known", [True, False])
def test_a_saved_pose_has_it(tmp_path: Path, known: bool) -> None:
    one = estimate(1300)
    if not known:
        one = replace(one, covariance=covariance(curvature(3), crop(known=False)), principal_point=None)
    one.save(tmp_path / "pose.json")
    saved = json.loads((tmp_path / "pose.json").read_text())
    assert one.covariance is not None
    assert one.standard_deviations is not None
    read = torch.tensor([[math.inf if entry is None else entry for entry in row] for row in saved["covariance"]])
    assert_close(read.double(), one.covariance, rtol=1e-6, atol=1e-9)
    deviations = saved["standard_deviations"]
    assert deviations["azimuth"] == pytest.approx(float(one.covariance[0, 0]) ** 0.5)
    assert saved["position"] == one.position.tolist()
    if known:
        assert deviations["distance_in_file_units"] == pytest.approx(1300 * deviations["distance"])
        assert one.position_std is not None
        assert saved["position_std"] == one.position_std.tolist()
    else:
        assert deviations["distance"] is deviations["distance_in_file_units"] is saved["position_std"] is None


# --- scenes ----------------------------------------------------------------------------------------------------------


def scenes(count: int) -> list[Scene]:
    viewpoints = sample_viewpoints(count, np.random.default_rng(0))
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    return [scene(k, sample_chairs(), viewpoints, clutter, seed=6) for k in range(count)]


@pytest.mark.slow
def test_scenes_have_their_true_poses_within_a_few_standard_deviations() -> None:
    """In a chi-squared test of 16 scenes; ``benchmarks/covariance.py`` has the coverage of many."""
    ratios = []
    for one in scenes(16):
        axis = one.camera.width / 2 + float(one.pose[4]), one.camera.height / 2 + float(one.pose[5])
        mesh = sample_chairs()[one.model]
        result = estimate_pose(one.image, mesh, box=one.box, focal=one.camera.focal, principal_point=axis)
        assert result.standard_deviations is not None
        off = result.pose[0] - one.pose
        off[0] = (off[0] + 180) % 360 - 180
        if off[[0, 1, 3]].abs().max() < 15:
            ratios.append(off / result.standard_deviations)
    within = (torch.stack(ratios).abs() <= 1).double().mean(0)
    assert len(ratios) >= 12
    assert 0.5 <= float(within.mean()) <= 0.85
    assert bool((within >= 0.3).all())
