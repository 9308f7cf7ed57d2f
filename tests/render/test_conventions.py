"""Other conventions, against a few lines of each one's own formulas; rigid motions against OpenCV."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import (
    Camera,
    Mesh,
    Pascal3D,
    from_pascal3d,
    from_pytorch3d,
    pose,
    silhouette,
    to_pascal3d,
    to_pytorch3d,
)
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.conventions import move_before_camera, pose_matrix, turn_to

from .shapes import by_opencv

Floats = NDArray[np.float64]
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (7, 3))
AZIMUTH, ELEVATION, THETA = st.floats(-360, 360), st.floats(-85, 85), st.floats(-170, 170)


def ours(poses: Tensor, camera: Camera) -> Floats:
    result: Floats = to_screen(to_camera(torch.from_numpy(POINTS), poses), poses, camera)[0, :, :2].numpy()
    return result


def turned(axis: str, degrees: float) -> Floats:
    """The matrix that turns columns about an axis, counter-clockwise when it looks at you."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array({"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis])


def by_pascal3d(view: Pascal3D) -> Floats:
    """Its camera looks along -z with y up; R = Rx(e - 90°) Rz(-a); 2D points are turned by theta, then y flipped."""
    turn = turned("x", view.elevation - 90) @ turned("z", -view.azimuth)
    a, e = math.radians(view.azimuth), math.radians(view.elevation)
    centre = view.distance * np.array([math.cos(e) * math.sin(a), -math.cos(e) * math.cos(a), math.sin(e)])
    x, y, z = turn @ (POINTS - centre).T
    flat = turned("z", view.theta)[:2, :2] @ (3000 * view.focal * np.array([x, y]) / -z)
    return np.stack([flat[0] + view.px, -flat[1] + view.py], axis=1)


@given(AZIMUTH, ELEVATION, THETA, st.floats(1.5, 20), st.floats(0.5, 2), st.floats(-50, 400), st.floats(-50, 400))
def test_pascal3d(
    azimuth: float, elevation: float, theta: float, distance: float, focal: float, px: float, py: float
) -> None:
    view = Pascal3D(azimuth, elevation, distance, theta, focal, px, py)
    poses, camera = from_pascal3d(view, 333, 500)
    expected = by_pascal3d(view) - 0.5  # the middle of its first pixel is at 1, that of ours at ½
    np.testing.assert_allclose(ours(poses, camera), expected, rtol=0, atol=1e-7)
    assert to_pascal3d(poses, camera) == pytest.approx(view)
    assert (camera.height, camera.width) == (333, 500)


def look_at(azimuth: float, elevation: float, distance: float) -> tuple[Floats, Floats]:
    """pytorch3d's ``look_at_view_transform``: R, whose columns are the camera's axes left, up, forward, and T."""
    a, e = math.radians(azimuth), math.radians(elevation)
    centre = distance * np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
    forward = -centre / np.linalg.norm(centre)
    left = np.cross([0, 1, 0], forward)
    left /= np.linalg.norm(left)
    rotation = np.stack([left, np.cross(forward, left), forward], axis=1)
    return rotation, -centre @ rotation


def by_pytorch3d(rotation: Floats, translation: Floats, fov: float, height: int, width: int) -> Floats:
    """Rows: X R + T; its screen has +x to the left and +y up, and 2 / min(H, W) of a unit to a pixel."""
    world = np.stack([POINTS[:, 0], POINTS[:, 2], -POINTS[:, 1]], axis=1)
    x, y, z = (world @ rotation + translation).T
    scale = min(height, width) / 2 / math.tan(math.radians(fov) / 2)
    return np.stack([width / 2 - scale * x / z, height / 2 - scale * y / z], axis=1)


@pytest.mark.slow
@given(AZIMUTH, ELEVATION, THETA, st.floats(1.5, 20), st.floats(5, 120))
def test_pytorch3d(azimuth: float, elevation: float, theta: float, distance: float, fov: float) -> None:
    rotation, translation = look_at(azimuth, elevation, distance)
    rotation = rotation @ turned("z", theta).T  # about its optical axis
    poses, camera = from_pytorch3d(torch.tensor(rotation)[None], torch.tensor(translation)[None], fov, 60, 90)
    expected = by_pytorch3d(rotation, translation, fov, 60, 90)
    np.testing.assert_allclose(ours(poses, camera), expected, rtol=0, atol=1e-7)
    back = to_pytorch3d(poses, camera)
    assert_close(back[0][0].numpy(), rotation, rtol=0, atol=1e-9)
    assert_close(back[1][0].numpy(), np.array([0, 0, distance]), rtol=0, atol=1e-9)
    assert back[2] == pytest.approx(fov)


@pytest.mark.parametrize("elevation", [90.0, -90.0])
def test_pytorch3d_straight_from_above_and_below(elevation: float) -> None:
    """Azimuth and theta do the same there; another pair may come back, but the same picture."""
    camera = Camera.from_field_of_view(40, 64, 64)
    at = pose(33, elevation, 3, 12)
    back, _ = from_pytorch3d(*to_pytorch3d(at, camera), 64, 64)
    np.testing.assert_allclose(ours(back, camera), ours(at, camera), atol=1e-9)


R, T = (torch.tensor(part)[None] for part in look_at(30, 20, 3))
SQUARE = Camera.from_field_of_view(40, 64, 64)


@pytest.mark.parametrize(
    ("convert", "message"),
    [
        (lambda: from_pytorch3d(R * torch.tensor([-1.0, 1, 1]), T, 60, 64, 64), "R must be rotations"),
        (lambda: from_pytorch3d(R, T + torch.tensor([0.5, 0, 0]), 60, 64, 64), "must look at the origin"),
        (lambda: from_pytorch3d(R, T[:, :2], 60, 64, 64), r"T must be a tensor \(1, 3\)"),
        (lambda: from_pytorch3d(R, 0 * T, 60, 64, 64), "distances above 0"),
        (lambda: to_pytorch3d(pose(0, x=1), SQUARE), "x and y must be 0"),
        (lambda: to_pascal3d(pose(0).expand(2, 6), SQUARE), "one pose"),
        *((lambda to=to: to(-pose(0), SQUARE), "distances above 0") for to in (to_pascal3d, to_pytorch3d)),
        (lambda: from_pascal3d(Pascal3D(30, 0, 0, 0, 1, 0, 0), 64, 64), "distances above 0"),  # a coarse viewpoint
        (lambda: from_pascal3d(Pascal3D(30, 0, 3, 0, 0, 0, 0), 64, 64), "focal, in pixels"),
    ],
)
def test_what_has_no_camera_or_cannot_be_said(convert: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        convert()


def test_numbers_alone_are_neither_a_camera_nor_a_view() -> None:
    for convert in (to_pascal3d, to_pytorch3d):
        with pytest.raises(TypeError, match=r"expected a nablahog.Camera, got a tuple"):
            convert(pose(0), (100.0, 64, 64))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="view must be"):
        from_pascal3d((30.0, 10.0, 5.0, 0.0, 1.0, 250.5, 188.0), 64, 64)  # type: ignore[arg-type]


SOLID = torch.rand(20, 3, dtype=torch.float64) - 0.5
INTRINSICS = torch.tensor([[300.0, 0, 70], [0, 300, 66], [0, 0, 1]], dtype=torch.float64)


def motion(azimuth: float = 40, elevation: float = 20, theta: float = -6) -> Tensor:
    """An object far off the optical axis."""
    matrix = pose_matrix(pose(azimuth, elevation, 2.7, theta)[0])
    matrix[:3, 3] += matrix.new_tensor([0.8, -0.5, 0.0])
    return matrix


@pytest.mark.parametrize("ray", [[0.0, 0, 1], [0.4, -0.3, 1], [3.0, 1, 0.1]])
def test_a_camera_turned_to_a_ray_looks_along_it(ray: list[float]) -> None:
    direction = torch.tensor(ray, dtype=torch.float64)
    turn = turn_to(direction)
    assert_close(turn @ turn.T, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(turn)) == pytest.approx(1)
    assert_close(turn @ direction, direction.new_tensor([0, 0, float(direction.norm())]))
    angle = math.acos(ray[2] / float(direction.norm()))
    assert math.acos((float(turn.trace()) - 1) / 2) == pytest.approx(angle, abs=1e-7)  # and by no more than that


def test_what_is_moved_is_drawn_where_opencv_sees_it() -> None:
    mesh = Mesh(SOLID, torch.arange(18).reshape(6, 3), torch.ones(20, dtype=torch.float64))
    moved, poses, camera = move_before_camera(mesh, motion(), INTRINSICS, 120, 160)
    assert (camera.height, camera.width, camera.focal) == (120, 160, 300)
    projected = to_screen(to_camera(moved.vertices, poses), poses, camera)[0, :, :2]
    assert_close(projected, by_opencv(SOLID, motion(), INTRINSICS), rtol=0, atol=1e-9)
    assert silhouette(moved, poses, camera).shape == (1, 1, 120, 160)
