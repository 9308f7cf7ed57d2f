"""Derivatives of images with respect to poses, from the derivative with respect to motion on the screen.

A point X at 1 / depth = w with the velocity ω x X + τ moves on the screen by a + b w.  a depends on ω and on the ray
through the middle of the pixel, b on τ and on the ray.
"""

from __future__ import annotations

from ctypes import c_bool, c_double, c_int64

import numpy as np
import torch
from torch import Tensor

from .. import native
from .camera import Camera, pose_velocities

_REALS, _DOUBLES = native.array(np.float32, np.float64), native.array(np.float64)
_pose_vjp = native.function("pose_vjp", c_bool, _REALS, _REALS, _DOUBLES, c_int64, c_double, c_int64, c_int64, _DOUBLES)


def _rays(poses: Tensor, camera: Camera, like: Tensor) -> tuple[Tensor, Tensor]:
    """x / depth and y / depth of the middles of pixels, (B, 1, W) and (B, H, 1)."""
    x = torch.arange(camera.width, device=poses.device) + 0.5 - camera.width / 2 - poses[:, 4:5]
    y = torch.arange(camera.height, device=poses.device) + 0.5 - camera.height / 2 - poses[:, 5:6]
    return (x / camera.focal).to(like)[:, None, :], (y / camera.focal).to(like)[:, :, None]


def pose_jacobian(screen_gradient: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Jacobian (B, 6, H, W) of images with respect to poses (B, 6): per degree, unit of the mesh, or pixel.

    Args:
        screen_gradient: (B, 4, H, W), of :class:`.rendering.Rendering`.
        poses, camera: those of the images.

    >>> from nablahog.render import Renderer, pose, pose_jacobian
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 32, 32)
    >>> poses = pose(azimuth=30, distance=3)
    >>> drawn = Renderer(mesh, camera).render(poses, torch.ones(1, 32, 32), derivative=True)
    >>> pose_jacobian(drawn.screen_gradient, poses, camera).shape
    torch.Size([1, 6, 32, 32])
    """
    angular, linear, shift = (part.to(screen_gradient)[..., None, None] for part in pose_velocities(poses))
    x, y = (part[:, None] for part in _rays(poses, camera, screen_gradient))
    (wx, wy, wz), (tx, ty, tz) = angular.unbind(2), linear.unbind(2)
    forward = wx * y - wy * x
    focal = camera.focal
    a_x = focal * (wy - wz * y - x * forward) + shift[:, :, 0]
    a_y = focal * (wz * x - wx - y * forward) + shift[:, :, 1]
    b_x, b_y = focal * (tx - x * tz), focal * (ty - y * tz)
    by_a_x, by_b_x, by_a_y, by_b_y = screen_gradient[:, None].unbind(2)
    return a_x * by_a_x + b_x * by_b_x + a_y * by_a_y + b_y * by_b_y


def pose_vjp(grad_image: Tensor, screen_gradient: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Gradient (B, 6) with respect to poses: the product of ``grad_image`` (B, H, W) and :func:`pose_jacobian`.

    Args:
        grad_image: gradient with respect to the images.
        screen_gradient, poses, camera: as for :func:`pose_jacobian`.

    >>> from nablahog.render import Renderer, pose, pose_vjp
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 32, 32)
    >>> poses = pose(azimuth=30, distance=3)
    >>> drawn = Renderer(mesh, camera).render(poses, torch.ones(1, 32, 32), derivative=True)
    >>> pose_vjp(torch.ones(1, 32, 32), drawn.screen_gradient, poses, camera).shape
    torch.Size([1, 6])
    """
    if native.can_read(grad_image, screen_gradient, poses):
        images, gradients = grad_image.to(screen_gradient).contiguous(), screen_gradient.contiguous()
        double, numbers = gradients.dtype == torch.float64, poses.detach().double().contiguous()
        grad_poses = torch.empty_like(numbers)
        _pose_vjp(
            double, images, gradients, numbers, len(numbers), camera.focal, camera.height, camera.width, grad_poses
        )
        return grad_poses.to(screen_gradient)
    jacobian = pose_jacobian(screen_gradient.double(), poses, camera)
    return torch.einsum("bkhw,bhw->bk", jacobian, grad_image.double()).to(screen_gradient)
