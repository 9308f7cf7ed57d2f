"""Poses to compare: azimuths all around, in degrees, and the distance and shift at which an outline fills a box."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from ..render import Camera, Mesh
from ..render.camera import rotation_matrices as rotations
from ..runtime.compile import compiled
from .crop import DISTANCE

_ROUNDS = 3  # perspective makes the size no exact inverse of the distance; twice is within a tenth of a pixel


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


def local_maxima(values: Tensor, count: int) -> Tensor:
    """Indices of the at most ``count`` highest local maxima on a circle of values (N,), the highest first."""
    highest = (values >= values.roll(1)) & (values >= values.roll(-1))
    indices = highest.nonzero().squeeze(1)
    order: Tensor = indices[values[indices].argsort(descending=True)]
    return order[:count]


def hull(mesh: Mesh) -> Tensor:
    """The vertices (N, 3) of the convex hull, which alone decide the box around any view of a mesh."""
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
        points: (N, 3), of the model, as of :func:`hull`.
        camera: of the image.
        size: width and height of a box of the same area, or the length of the longer side, perhaps (B,), pixels.
    """
    placed = poses.clone()
    turned = rotations(poses.detach().double().numpy())
    boxes = np.empty((len(poses), 4))
    vertices = points.double().numpy()
    for round_ in range(_ROUNDS + 1):
        _bounds(vertices, turned, placed[:, 2].double().numpy(), camera.focal, boxes)
        low, high = (torch.from_numpy(part) + placed[:, 4:] for part in (boxes[:, :2], boxes[:, 2:]))
        if round_ < _ROUNDS:
            sides = (high - low).clamp(min=1e-6)
            zoom = (size[0] * size[1] / sides.prod(1)).sqrt() if isinstance(size, tuple) else size / sides.amax(1)
            placed[:, 2] = (placed[:, 2] / zoom).clamp(min=1.0)
        placed[:, 4:] = placed[:, 4:] - (low + high) / 2
    return placed


def bounding_boxes(poses: Tensor, points: Tensor, camera: Camera) -> Tensor:
    """The boxes x0, y0, x1, y1 around points (N, 3) at poses (B, 6), (B, 4), pixels from the middle of the image."""
    boxes = np.empty((len(poses), 4))
    turned, distances = rotations(poses.double().numpy()), poses[:, 2].double().numpy()
    _bounds(points.double().numpy(), turned, distances, camera.focal, boxes)
    return torch.from_numpy(boxes) + poses[:, [4, 5, 4, 5]]


@compiled
def _bounds(points: Any, turned: Any, distances: Any, focal: float, boxes: Any) -> None:
    """The boxes around points (N, 3) at poses, relative to the principal point: x0, y0, x1, y1, (B, 4)."""
    for b in range(turned.shape[0]):
        rotation, distance = turned[b], distances[b]
        x0 = y0 = np.inf
        x1 = y1 = -np.inf
        for n in range(points.shape[0]):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            inverse = focal / (rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + distance)
            across = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) * inverse
            down = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) * inverse
            x0, x1 = min(x0, across), max(x1, across)
            y0, y1 = min(y0, down), max(y1, down)
        boxes[b, 0], boxes[b, 1], boxes[b, 2], boxes[b, 3] = x0, y0, x1, y1
