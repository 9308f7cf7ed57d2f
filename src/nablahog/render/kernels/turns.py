"""What poses mean, in loops: :func:`..camera.rotations` and :func:`..camera.motion` are tens of operations each, which
take PyTorch longer than what is made from them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.compile import compiled

Doubles = NDArray[np.float64]


def turns(poses: Doubles) -> Doubles:
    """:func:`..camera.rotations` of poses (B, 6), (B, 3, 3)."""
    found = np.empty((len(poses), 3, 3))
    _turns(poses, found)
    return found


def by_pose(sums: Doubles, poses: Doubles, focal: float) -> Doubles:
    """Derivatives (B, 6) by poses (B, 6) from the sums (B, 4, 3, 3) of :func:`.moments.moments`.

    It is what :func:`..renderer.pull_back` says, with :func:`..camera.motion` written out.
    """
    found = np.empty(poses.shape)
    _by_pose(sums, poses, focal, found)
    return found


@compiled
def _turns(poses: Any, found: Any) -> None:
    for b in range(poses.shape[0]):
        azimuth, elevation, theta = math.radians(poses[b, 0]), math.radians(poses[b, 1]), math.radians(poses[b, 3])
        sa, ca, se, ce = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
        st, ct = math.sin(theta), math.cos(theta)
        right, down, forward = (ca, sa, 0.0), (se * sa, -se * ca, -ce), (-ce * sa, ce * ca, -se)
        for k in range(3):
            found[b, 0, k] = ct * right[k] + st * down[k]
            found[b, 1, k] = ct * down[k] - st * right[k]
            found[b, 2, k] = forward[k]


@compiled
def _by_pose(sums: Any, poses: Any, focal: float, found: Any) -> None:
    degree = math.pi / 180
    for b in range(poses.shape[0]):
        elevation, distance, theta = math.radians(poses[b, 1]), poses[b, 2], math.radians(poses[b, 3])
        se, ce, st, ct = math.sin(elevation), math.cos(elevation), math.sin(theta), math.cos(theta)
        along_x, near_x, along_y, near_y = sums[b, 0], sums[b, 1], sums[b, 2], sums[b, 3]
        # turns about the camera's axes, of the object about its origin at the distance, and moves towards the camera
        about_x = -along_x[1, 1] - along_y[0, 0] - along_y[0, 2] + distance * near_y[0, 0]
        about_y = along_x[0, 0] + along_x[2, 0] + along_y[1, 1] - distance * near_x[0, 0]
        about_z = along_y[1, 0] - along_x[0, 1]
        found[b, 0] = focal * degree * (st * ce * about_x + ct * ce * about_y + se * about_z)
        found[b, 1] = focal * degree * (ct * about_x - st * about_y)
        found[b, 2] = -focal * (near_x[1, 0] + near_y[0, 1])
        found[b, 3] = -focal * degree * about_z
        found[b, 4], found[b, 5] = along_x[0, 0], along_y[0, 0]
