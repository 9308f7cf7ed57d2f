"""Cameras: where points are seen, how every parameter of a pose moves them, and derivatives of images by poses."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog import native
from nablahog.render import Camera, pose, pose_jacobian, pose_vjp
from nablahog.render.camera import check_poses, pose_velocities, rotation_matrices, rotations, to_camera, to_screen

from .shapes import poses

CAMERA = Camera(100.0, 60, 80)
ANY_POSE = st.tuples(
    st.floats(-400, 400), st.floats(-90, 90), st.floats(2, 50), st.floats(-180, 180), st.floats(-9, 9), st.floats(-9, 9)
)


def seen(point: tuple[float, float, float], poses: Tensor) -> list[float]:
    points = torch.tensor([point], dtype=torch.float64)
    return to_screen(to_camera(points, poses), poses, CAMERA)[0, 0].tolist()


def test_projection_by_hand() -> None:
    assert seen((0, 0, 0), pose(0, distance=2)) == pytest.approx([40, 30, 1 / 2])
    assert seen((0.5, 0, 0.25), pose(0, distance=2)) == pytest.approx([40 + 100 * 0.5 / 2, 30 - 100 * 0.25 / 2, 1 / 2])
    assert seen((0.5, -1, 0), pose(0, distance=2)) == pytest.approx([40 + 100 * 0.5, 30, 1])  # the front is nearer
    assert seen((0, 0.5, 0), pose(90, distance=2)) == pytest.approx([40 + 100 * 0.5 / 2, 30, 1 / 2])
    assert seen((0, 1, 0), pose(0, 90, 2)) == pytest.approx([40, 30 - 100 / 2, 1 / 2])  # the back is above, from above


@given(ANY_POSE)
def test_motion_is_the_derivative_of_the_projection(numbers: tuple[float, ...]) -> None:
    at = pose(*numbers)
    points = torch.randn(5, 3, dtype=torch.float64) * 0.4
    turn, move, shift = (part[0] for part in pose_velocities(at))
    inside = to_camera(points, at)[0]
    velocity = torch.linalg.cross(turn[:, None].expand(6, 5, 3), inside.expand(6, 5, 3)) + move[:, None]
    inverse = 1 / inside[:, 2:]
    flow = CAMERA.focal * (velocity[..., :2] - inside[:, :2] * inverse * velocity[..., 2:]) * inverse + shift[:, None]
    for k in range(6):
        step = torch.zeros(1, 6, dtype=torch.float64)
        step[0, k] = 1e-4
        before, after = (to_screen(to_camera(points, p), p, CAMERA)[0] for p in (at - step, at + step))
        difference = (after - before) / 2e-4
        assert_close(flow[k], difference[:, :2], rtol=1e-6, atol=1e-6)
        assert_close(-velocity[k, :, 2] * inverse[:, 0] ** 2, difference[:, 2], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("degrees", [0, 180])
def test_no_field_of_view(degrees: float) -> None:
    with pytest.raises(ValueError, match="above 0 and below 180"):
        Camera.from_field_of_view(degrees, 10, 10)


@pytest.mark.parametrize("poses", [torch.ones(2, 5), torch.ones(0, 6), pose(0, distance=0), pose(0) / 0])
def test_no_poses(poses: Tensor) -> None:
    with pytest.raises(ValueError, match="poses must be"):
        check_poses(poses)


SMALL = Camera(300.0, 20, 30)


both = pytest.mark.parametrize("loops", [True, False], ids=["native", "plain"])


@both
def test_rotations(loops: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not loops:
        monkeypatch.setattr(native, "library", lambda: None)
    for where in (poses(7, 3.0), poses(7, 3.0)[::2]):
        result = rotation_matrices(where.numpy())
        np.testing.assert_allclose(result, rotations(where).numpy(), rtol=1e-12, atol=1e-12)


@both
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_vjp_is_the_adjoint_of_the_jacobian(
    dtype: torch.dtype, loops: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not loops:
        monkeypatch.setattr(native, "library", lambda: None)
    where, generator = poses(7, 3.0), torch.Generator().manual_seed(1)
    grad_image = torch.randn(7, 20, 30, generator=generator, dtype=torch.float64)
    screen_gradient = torch.randn(7, 4, 20, 30, generator=generator, dtype=torch.float64)
    expected = torch.einsum("bkhw,bhw->bk", pose_jacobian(screen_gradient, where, SMALL), grad_image).to(dtype)
    grad_image, screen_gradient = grad_image.to(dtype), screen_gradient.to(dtype)
    tolerance = 1e-9 if dtype == torch.float64 else 1e-4
    assert_close(pose_vjp(grad_image, screen_gradient, where, SMALL), expected, rtol=tolerance, atol=10 * tolerance)
    mapped = torch.func.vmap(lambda one: pose_vjp(one, screen_gradient, where, SMALL))(
        torch.stack([grad_image, 2 * grad_image])
    )
    assert_close(mapped, torch.stack([expected, 2 * expected]), rtol=tolerance, atol=10 * tolerance)
