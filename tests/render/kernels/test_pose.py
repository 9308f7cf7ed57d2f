"""Compiled loops over poses against the PyTorch operations that they replace."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from nablahog.render import Camera
from nablahog.render.camera import rotations
from nablahog.render.kernels import pose as kernels
from nablahog.render.pose_gradient import pose_jacobian, pose_vjp

CAMERA = Camera(300.0, 20, 30)


def some_poses() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    spread = torch.tensor([200.0, 60, 0.3, 40, 5, 5], dtype=torch.float64)
    middle = torch.tensor([0.0, 0, 3, 0, 0, 0], dtype=torch.float64)
    return middle + spread * torch.randn(7, 6, generator=generator, dtype=torch.float64)


def test_rotations() -> None:
    assert_close(
        torch.from_numpy(kernels.rotations(some_poses().numpy())), rotations(some_poses()), rtol=1e-12, atol=1e-12
    )


def test_the_vjp_is_the_adjoint_of_the_jacobian() -> None:
    poses, generator = some_poses(), torch.Generator().manual_seed(1)
    grad_image = torch.randn(7, 20, 30, generator=generator, dtype=torch.float64)
    screen_gradient = torch.randn(7, 4, 20, 30, generator=generator, dtype=torch.float64)
    expected = torch.einsum("bkhw,bhw->bk", pose_jacobian(screen_gradient, poses, CAMERA), grad_image)
    assert_close(pose_vjp(grad_image, screen_gradient, poses, CAMERA), expected, rtol=1e-9, atol=1e-9)
    mapped = torch.func.vmap(lambda one: pose_vjp(one, screen_gradient, poses, CAMERA))(
        torch.stack([grad_image, 2 * grad_image])
    )
    assert_close(mapped, torch.stack([expected, 2 * expected]), rtol=1e-9, atol=1e-9)
