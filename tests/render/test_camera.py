"""Cameras: where points are seen, how every parameter of a pose moves them, and derivatives of images by poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog import native
from nablahog.render import Camera, Renderer, depth_and_normals, pose, pose_jacobian, pose_vjp
from nablahog.render.camera import check_poses, pose_velocities, rotation_matrices, rotations, to_camera, to_screen
from nablahog.render.renderer import EdgeMethod

from .shapes import box, poses

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
def test_the_camera_is_where_it_is_said_to_be(numbers: tuple[float, ...]) -> None:
    azimuth, elevation, distance = math.radians(numbers[0]), math.radians(numbers[1]), numbers[2]
    level = distance * math.cos(elevation)
    place = [level * math.sin(azimuth), -level * math.cos(azimuth), distance * math.sin(elevation)]
    result = to_camera(torch.tensor([place], dtype=torch.float64), pose(*numbers))
    assert_close(result, torch.zeros(1, 1, 3, dtype=torch.float64), rtol=0, atol=1e-12)


@given(ANY_POSE)
def test_rotations_turn_and_do_not_mirror(numbers: tuple[float, ...]) -> None:
    (turn,) = rotations(pose(*numbers))
    assert_close(turn @ turn.T, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-12)
    assert_close(torch.linalg.cross(turn[0], turn[1]), turn[2], rtol=0, atol=1e-12)  # right x down is forward


@pytest.mark.parametrize(
    ("changed", "point", "axis", "sign"),
    [
        ({"azimuth": 10}, (0, -0.5, 0), 0, -1),  # the camera goes to its right, what is near to its left
        ({"elevation": 10}, (0, -0.5, 0), 1, 1),  # the camera goes up, what is near down
        ({"theta": 10}, (0.5, 0, 0), 1, -1),  # counter-clockwise: what is right goes up,
        ({"theta": 10}, (0, 0, 0.5), 0, -1),  # and what is above to the left
        ({"distance": 5}, (0.5, 0, 0), 0, -1),  # towards the middle
        ({"x": 10}, (0, 0, 0), 0, 1),
        ({"y": 10}, (0, 0, 0), 1, 1),
    ],
)
def test_signs(changed: dict[str, float], point: tuple[float, float, float], axis: int, sign: int) -> None:
    before, after = seen(point, pose(0)), seen(point, pose(**{"azimuth": 0, **changed}))
    assert sign * (after[axis] - before[axis]) > 1
    assert after[1 - axis] == pytest.approx(before[1 - axis], abs=1)


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
    for read in (check_poses, lambda wrong: depth_and_normals(box(), wrong, CAMERA)):
        with pytest.raises(ValueError, match="poses must be"):
            read(poses)


def test_products_are_refused_of_other_shapes_than_those_of_the_images() -> None:
    gradient, at, camera = torch.zeros(2, 4, *(size := (CAMERA.height, CAMERA.width))), poses(2, 3), CAMERA
    for wrong in ((gradient, at[:1]), (gradient[:, :3], at), (gradient[..., 1:], at), (gradient, at[:, :5])):
        for product in (pose_jacobian, lambda *of: pose_vjp(torch.zeros(2, *size), *of)):
            with pytest.raises(ValueError, match="must be a tensor"):
                product(*wrong, camera)
    for grad_image in (torch.zeros(1, *size), torch.zeros(2, 1, *size), torch.zeros(2, *size[::-1])):
        with pytest.raises(ValueError, match="grad_image must be a tensor"):
            pose_vjp(grad_image, gradient, at, camera)
    for read in (lambda other: pose_jacobian(gradient, at, other), lambda other: depth_and_normals(box(), at, other)):
        with pytest.raises(TypeError, match=r"expected a nablahog.Camera"):
            read(100.0)


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


@pytest.mark.parametrize("method", ["edges", "opendr"])
def test_reverse_mode_of_a_renderer_is_this_vjp(method: EdgeMethod) -> None:
    renderer = Renderer(box(), SMALL, method=method, supersampling=2)
    where, background, grad_image = poses(3, 2.6), torch.rand(1, 1, 20, 30), torch.randn(3, 20, 30)
    rendering = renderer.render(where, background[:, 0], derivative=True)
    expected = pose_vjp(grad_image, rendering.screen_gradient, where, SMALL)
    followed = where.clone().requires_grad_()
    images = renderer(followed, background)[:, 0]
    assert_close(images, rendering.image.clamp(0, 1), rtol=0, atol=0)
    (reverse,) = torch.autograd.grad((images * grad_image).sum(), followed)
    assert_close(reverse, expected.double())
