"""Derivatives by poses, in native loops and in PyTorch, and the rotations that poses mean."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from nablahog import native
from nablahog.render import Camera, Renderer, pose_jacobian, pose_vjp
from nablahog.render.camera import rotation_matrices, rotations
from nablahog.render.renderer import Method

from .shapes import box, poses

CAMERA = Camera(300.0, 20, 30)


def some_poses() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    spread = torch.tensor([200.0, 60, 0.3, 40, 5, 5], dtype=torch.float64)
    middle = torch.tensor([0.0, 0, 3, 0, 0, 0], dtype=torch.float64)
    return middle + spread * torch.randn(7, 6, generator=generator, dtype=torch.float64)


both = pytest.mark.parametrize("loops", [True, False], ids=["native", "plain"])


@both
def test_rotations(loops: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not loops:
        monkeypatch.setattr(native, "library", lambda: None)
    for where in (some_poses(), some_poses()[::2]):
        result = rotation_matrices(where.numpy())
        np.testing.assert_allclose(result, rotations(where).numpy(), rtol=1e-12, atol=1e-12)


@both
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_vjp_is_the_adjoint_of_the_jacobian(
    dtype: torch.dtype, loops: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not loops:
        monkeypatch.setattr(native, "library", lambda: None)
    where, generator = some_poses(), torch.Generator().manual_seed(1)
    grad_image = torch.randn(7, 20, 30, generator=generator, dtype=torch.float64)
    screen_gradient = torch.randn(7, 4, 20, 30, generator=generator, dtype=torch.float64)
    expected = torch.einsum("bkhw,bhw->bk", pose_jacobian(screen_gradient, where, CAMERA), grad_image).to(dtype)
    grad_image, screen_gradient = grad_image.to(dtype), screen_gradient.to(dtype)
    tolerance = 1e-9 if dtype == torch.float64 else 1e-4
    assert_close(pose_vjp(grad_image, screen_gradient, where, CAMERA), expected, rtol=tolerance, atol=10 * tolerance)
    mapped = torch.func.vmap(lambda one: pose_vjp(one, screen_gradient, where, CAMERA))(
        torch.stack([grad_image, 2 * grad_image])
    )
    assert_close(mapped, torch.stack([expected, 2 * expected]), rtol=tolerance, atol=10 * tolerance)


@pytest.mark.parametrize("method", ["edges", "opendr"])
def test_reverse_mode_of_a_renderer_is_this_vjp(method: Method) -> None:
    renderer = Renderer(box(), CAMERA, method=method, supersampling=2)
    where, background, grad_image = poses(3, 2.6), torch.rand(1, 1, 20, 30), torch.randn(3, 20, 30)
    rendering = renderer.render(where, background[:, 0], derivative=True)
    expected = pose_vjp(grad_image, rendering.screen_gradient, where, CAMERA)
    followed = where.clone().requires_grad_()
    images = renderer(followed, background)[:, 0]
    assert_close(images, rendering.image.clamp(0, 1), rtol=0, atol=0)
    (reverse,) = torch.autograd.grad((images * grad_image).sum(), followed)
    assert_close(reverse, expected.double())
