"""Poses all around a model, and the distance and shift at which its outline fills a box."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from ..render import Camera, Mesh
from ..render.camera import rotation_matrices as rotations
from .crop import DISTANCE

Doubles = NDArray[np.float64]

VIEW_COUNT = 48  # azimuths around an object, at which the coarse search looks at models
_ROUNDS = 3  # with perspective the size is not quite the inverse of the distance; twice is within a tenth of a pixel


def equidistant_azimuths(count: int, first: float = 0.0) -> Tensor:
    """All around, (count,), float64, degrees."""
    return first + torch.arange(count, dtype=torch.float64) * (360 / count)


def azimuth_sweep(pose: Tensor, views: int) -> Tensor:
    """``views`` equidistant azimuths from a pose (6,) on, (views, 6); all else stays."""
    poses = pose.repeat(views, 1)
    poses[:, 0] += equidistant_azimuths(views)
    return poses


def azimuth_distance(one: float, other: float) -> float:
    """Degrees between azimuths, in 0…180."""
    return abs((one - other + 180) % 360 - 180)


def signed_angles(angles: Tensor) -> Tensor:
    """The same angles in -180…180 degrees."""
    return (angles + 180) % 360 - 180


def local_maxima(values: Tensor, count: int) -> Tensor:
    """Indices of the at most ``count`` highest local maxima on a circle of values (N,), the highest first."""
    highest = (values >= values.roll(1)) & (values >= values.roll(-1))
    indices = highest.nonzero().squeeze(1)
    order: Tensor = indices[values[indices].argsort(descending=True)]
    return order[:count]


def hull(mesh: Mesh) -> Tensor:
    """The vertices (N, 3) of the convex hull: they determine the box around any view of a mesh."""
    points = mesh.vertices.detach().cpu().numpy()
    try:
        return torch.from_numpy(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # in one plane, or too few
        return torch.from_numpy(np.unique(points, axis=0))


def level_poses(azimuths: Tensor, elevation: float) -> Tensor:
    """Poses (N, 6) at azimuths (N,) and an elevation, degrees, not turned in the image plane, still to be placed."""
    poses = torch.tensor([0, elevation, DISTANCE, 0, 0, 0], dtype=torch.float64).repeat(len(azimuths), 1)
    poses[:, 0] = azimuths
    return poses


def fit_to_box(poses: Tensor, points: Tensor, camera: Camera, size: tuple[float, float] | float | Tensor) -> Tensor:
    """Poses with the distance and shift at which the points' box lies in the middle of the image and has a given size.

    Args:
        poses: (B, 6), angles in degrees, see :data:`nablahog.render.PARAMETERS`.
        points: (N, 3), of the model, see :func:`hull`.
        camera: of the image.
        size: width and height of a box of the same area, or the length of the longer side, perhaps (B,), pixels.
    """
    placed = poses.detach().double().numpy().copy()
    turned = _turned(placed, points)
    for round_ in range(_ROUNDS + 1):
        boxes = _boxes(turned, placed[:, 2], camera)
        low, high = boxes[:, :2] + placed[:, 4:], boxes[:, 2:] + placed[:, 4:]
        if round_ < _ROUNDS:
            sides = (high - low).clip(min=1e-6)
            if isinstance(size, tuple):
                zoom = np.sqrt(size[0] * size[1] / sides.prod(1))
            else:
                zoom = np.asarray(size) / sides.max(1)
            placed[:, 2] = (placed[:, 2] / zoom).clip(min=1.0)
        placed[:, 4:] -= (low + high) / 2
    return torch.from_numpy(placed).to(poses.dtype)


def tilt_views(poses: Tensor, tilts: Tensor) -> Tensor:
    """Level poses (B, 6) turned by tilts (B,), degrees counter-clockwise, about the middle of the image."""
    angle = torch.deg2rad(tilts)
    x, y = poses[:, 4], poses[:, 5]
    across, down = angle.cos() * x + angle.sin() * y, angle.cos() * y - angle.sin() * x
    return torch.cat([poses[:, :3], torch.stack([tilts, across, down], 1)], 1)


def bounding_boxes(poses: Tensor, points: Tensor, camera: Camera) -> Tensor:
    """The boxes x0, y0, x1, y1 around points (N, 3) at poses (B, 6), (B, 4), pixels from the middle of the image."""
    of_poses = poses.double().numpy()
    return torch.from_numpy(_boxes(_turned(of_poses, points), of_poses[:, 2], camera)) + poses[:, [4, 5, 4, 5]]


def _turned(poses: Doubles, points: Tensor) -> Doubles:
    """Points (N, 3) turned as at poses (B, 6), in the directions of the camera's axes, (B, 3, N)."""
    turned: Doubles = rotations(poses) @ points.double().numpy().T
    return turned


def _boxes(turned: Doubles, distances: Doubles, camera: Camera) -> Doubles:
    """The boxes (B, 4) around turned points (B, 3, N) at distances (B,), pixels from the projected origin."""
    screen = turned[:, :2] * (camera.focal / (turned[:, 2] + distances[:, np.newaxis]))[:, np.newaxis]
    return np.concatenate([screen.min(axis=2), screen.max(axis=2)], axis=1)
