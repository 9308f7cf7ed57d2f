"""Rigid motions: against the renderer's own projection, and against OpenCV's."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, pose, silhouette
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.conventions import in_convention, moved_before, pose_matrix, turn_to

POINTS = torch.rand(20, 3, dtype=torch.float64) - 0.5
INTRINSICS = torch.tensor([[300.0, 0, 70], [0, 300, 66], [0, 0, 1]], dtype=torch.float64)


def motion(azimuth: float = 40, elevation: float = 20, theta: float = -6) -> Tensor:
    """An object far off the optical axis."""
    matrix = pose_matrix(pose(azimuth, elevation, 2.7, theta)[0])
    matrix[:3, 3] += matrix.new_tensor([0.8, -0.5, 0.0])
    return matrix


def by_opencv(points: Tensor, matrix: Tensor, intrinsics: Tensor) -> Tensor:
    turn, _ = cv2.Rodrigues(matrix[:3, :3].numpy())
    seen, _ = cv2.projectPoints(points.numpy(), turn, matrix[:3, 3].numpy(), intrinsics.numpy(), np.zeros(4))
    return torch.from_numpy(seen[:, 0])


@pytest.mark.parametrize("ray", [[0.0, 0, 1], [0.4, -0.3, 1], [3.0, 1, 0.1]])
def test_a_camera_turned_to_a_ray_looks_along_it(ray: list[float]) -> None:
    direction = torch.tensor(ray, dtype=torch.float64)
    turn = turn_to(direction)
    assert_close(turn @ turn.T, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(turn)) == pytest.approx(1)
    assert_close(turn @ direction, direction.new_tensor([0, 0, float(direction.norm())]))
    angle = math.acos(ray[2] / float(direction.norm()))
    assert math.acos((float(turn.trace()) - 1) / 2) == pytest.approx(angle, abs=1e-7)  # and by no more than that


def test_a_pose_as_a_matrix_projects_as_the_renderer_does() -> None:
    poses, camera = pose(40, 20, 2.7, -6, 11.5, -7.25), Camera(300.0, 120, 160)
    expected = to_screen(to_camera(POINTS, poses), poses, camera)[0, :, :2]
    intrinsics = torch.tensor([[300, 0, 80 + 11.5], [0, 300, 60 - 7.25], [0, 0, 1]], dtype=torch.float64)
    assert_close(by_opencv(POINTS, pose_matrix(poses[0]), intrinsics), expected, rtol=0, atol=1e-9)


def test_what_is_moved_is_drawn_where_opencv_sees_it() -> None:
    mesh = Mesh(POINTS, torch.arange(18).reshape(6, 3), torch.ones(20, dtype=torch.float64))
    moved, poses, camera = moved_before(mesh, motion(), INTRINSICS, 120, 160)
    assert (camera.height, camera.width, camera.focal) == (120, 160, 300)
    projected = to_screen(to_camera(moved.vertices, poses), poses, camera)[0, :, :2]
    assert_close(projected, by_opencv(POINTS, motion(), INTRINSICS), rtol=0, atol=1e-9)
    assert silhouette(moved, poses, camera).shape == (1, 1, 120, 160)


def test_opengls_camera_looks_backward() -> None:
    matrix = motion()
    assert in_convention(matrix, "opencv") is matrix
    seen = in_convention(matrix, "opengl")
    assert_close(seen[1:3], -matrix[1:3])
    assert_close(seen[[0, 3]], matrix[[0, 3]])
    assert float(torch.linalg.det(seen[:3, :3])) == pytest.approx(1)
    with pytest.raises(ValueError, match="convention must be 'opencv' or 'opengl', got 'blender'"):
        in_convention(matrix, "blender")  # type: ignore[arg-type]
