"""Poses in compiled loops: rotations, and gradients with respect to poses.

:func:`..camera.rotations` and :func:`..camera.pose_velocities` are tens of PyTorch operations on a few numbers, which
take longer than the rest of a small rendering.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...runtime.compile import compiled
from .arrays import Floats

Doubles = NDArray[np.float64]


@compiled
def rotations(poses: Doubles) -> Doubles:
    """:func:`..camera.rotations` of poses (B, 6), (B, 3, 3)."""
    matrices = np.empty((len(poses), 3, 3))
    for b in range(poses.shape[0]):
        azimuth, elevation, theta = math.radians(poses[b, 0]), math.radians(poses[b, 1]), math.radians(poses[b, 3])
        sa, ca, se, ce = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
        st, ct = math.sin(theta), math.cos(theta)
        right, down, forward = (ca, sa, 0.0), (se * sa, -se * ca, -ce), (-ce * sa, ce * ca, -se)
        for k in range(3):
            matrices[b, 0, k] = ct * right[k] + st * down[k]
            matrices[b, 1, k] = ct * down[k] - st * right[k]
            matrices[b, 2, k] = forward[k]
    return matrices


def moments(grad_image: Tensor, screen_gradient: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Σ over pixels of ``grad_image`` · ``screen_gradient`` · x^m · y^n, for m and n in 0…2.

    Args:
        grad_image: (B, H, W), the gradient with respect to the image.
        screen_gradient: (B, 4, H, W), of :class:`.compiled.Rendering`.
        x, y: (B, 1, W) and (B, H, 1), coordinates of the pixels.

    Returns:
        (B, 4, 3, 3), float64; the last two indices are m and n.
    """
    try:
        arrays = [part.numpy(force=True) for part in (grad_image, screen_gradient, x[:, 0], y[:, :, 0])]
    except RuntimeError:  # inside a function transform tensors have numbers but show no memory
        powers_of_x = torch.cat([torch.ones_like(x), x, x * x], 1)[:, None].double()
        powers_of_y = torch.cat([torch.ones_like(y), y, y * y], 2)[:, None].double()
        return powers_of_x @ (screen_gradient * grad_image[:, None]).double().mT @ powers_of_y
    sums = np.zeros((*screen_gradient.shape[:2], 3, 3))
    _moments(*map(np.ascontiguousarray, arrays), sums)
    return torch.from_numpy(sums)


@compiled
def _moments(grad_image: Floats, screen_gradient: Floats, x: Floats, y: Floats, sums: Doubles) -> None:
    batch, channels, height, width = screen_gradient.shape
    columns = np.empty((3, width))
    for b in range(batch):
        for channel in range(channels):
            columns[:] = 0
            for i in range(height):
                first = np.float64(y[b, i])
                second = first * first
                for j in range(width):  # one sum for each column, so that the compiler can use vector instructions
                    part = np.float64(grad_image[b, i, j] * screen_gradient[b, channel, i, j])
                    columns[0, j] += part
                    columns[1, j] += part * first
                    columns[2, j] += part * second
            for n in range(3):
                for j in range(width):
                    part, first = columns[n, j], np.float64(x[b, j])
                    sums[b, channel, 0, n] += part
                    sums[b, channel, 1, n] += part * first
                    sums[b, channel, 2, n] += part * first * first


@compiled
def vjp_from_moments(sums: Doubles, poses: Doubles, focal: float) -> Doubles:
    """Gradient (B, 6) with respect to poses (B, 6) from the :func:`moments` (B, 4, 3, 3).

    It is the PyTorch code of :func:`..pose_gradient.pose_vjp` with :func:`..camera.pose_velocities` written out.
    """
    grad_poses = np.empty(poses.shape)
    degree = math.pi / 180
    for b in range(poses.shape[0]):
        elevation, distance, theta = math.radians(poses[b, 1]), poses[b, 2], math.radians(poses[b, 3])
        se, ce, st, ct = math.sin(elevation), math.cos(elevation), math.sin(theta), math.cos(theta)
        x, x_depth, y, y_depth = sums[b, 0], sums[b, 1], sums[b, 2], sums[b, 3]
        # rotations of the object about its own origin, with the axes of the camera
        about_x = -x[1, 1] - y[0, 0] - y[0, 2] + distance * y_depth[0, 0]
        about_y = x[0, 0] + x[2, 0] + y[1, 1] - distance * x_depth[0, 0]
        about_z = y[1, 0] - x[0, 1]
        grad_poses[b, 0] = focal * degree * (st * ce * about_x + ct * ce * about_y + se * about_z)
        grad_poses[b, 1] = focal * degree * (ct * about_x - st * about_y)
        grad_poses[b, 2] = -focal * (x_depth[1, 0] + y_depth[0, 1])
        grad_poses[b, 3] = -focal * degree * about_z
        grad_poses[b, 4], grad_poses[b, 5] = x[0, 0], y[0, 0]
    return grad_poses
