"""Poses in loops: the same as the operations they stand for."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from nablahog.render import Camera
from nablahog.render.camera import rotations
from nablahog.render.kernels.turns import turns
from nablahog.render.renderer import pose_jacobian, pull_back

CAMERA = Camera(300.0, 20, 30)


def some_poses() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    spread = torch.tensor([200.0, 60, 0.3, 40, 5, 5], dtype=torch.float64)
    middle = torch.tensor([0.0, 0, 3, 0, 0, 0], dtype=torch.float64)
    return middle + spread * torch.randn(7, 6, generator=generator, dtype=torch.float64)


def test_turns_are_rotations() -> None:
    assert_close(torch.from_numpy(turns(some_poses().numpy())), rotations(some_poses()), rtol=1e-12, atol=1e-12)


def test_pulling_back_is_the_adjoint_of_the_jacobian() -> None:
    poses, generator = some_poses(), torch.Generator().manual_seed(1)
    given = torch.randn(7, 20, 30, generator=generator, dtype=torch.float64)
    moved = torch.randn(7, 4, 20, 30, generator=generator, dtype=torch.float64)
    expected = torch.einsum("bkhw,bhw->bk", pose_jacobian(moved, poses, CAMERA), given)
    assert_close(pull_back(given, moved, poses, CAMERA), expected, rtol=1e-9, atol=1e-9)
    mapped = torch.func.vmap(lambda one: pull_back(one, moved, poses, CAMERA))(torch.stack([given, 2 * given]))
    assert_close(mapped, torch.stack([expected, 2 * expected]), rtol=1e-9, atol=1e-9)
