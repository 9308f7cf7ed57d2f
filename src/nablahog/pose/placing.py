"""Where an object must be for its outline to fill a given box: distance and shift, whatever side it is seen from."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from ..render import Camera, Mesh
from ..render.kernels.pose import rotations
from ..runtime.compile import compiled
from .canvas import DISTANCE

_ROUNDS = 3  # perspective makes the size no exact inverse of the distance; twice is within a tenth of a pixel


def hull(mesh: Mesh) -> Tensor:
    """The vertices (N, 3) that alone decide the box around any view of a mesh."""
    points = mesh.vertices.detach().cpu().numpy()
    try:
        return torch.from_numpy(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # in one plane, or too few
        return torch.from_numpy(np.unique(points, axis=0))


def upright(azimuths: Tensor, elevation: float) -> Tensor:
    """Poses (N, 6) at azimuths (N,) and an elevation, in degrees, to be placed."""
    poses = torch.tensor([0, elevation, DISTANCE, 0, 0, 0], dtype=torch.float64).repeat(len(azimuths), 1)
    poses[:, 0] = azimuths
    return poses


def place(poses: Tensor, points: Tensor, camera: Camera, size: tuple[float, float] | float) -> Tensor:
    """``poses`` (B, 6) with distance, x and y such that the box around ``points`` has its middle in the middle of the
    image, and the area of one of ``size`` (width, height), or ``size`` for its longer side."""
    placed = poses.clone()
    turned = rotations(poses.detach().double().numpy())
    corners = np.empty((len(poses), 4))
    vertices = points.double().numpy()
    for round_ in range(_ROUNDS + 1):
        _bounds(vertices, turned, placed[:, 2].double().numpy(), camera.focal, corners)
        low, high = (torch.from_numpy(part) + placed[:, 4:] for part in (corners[:, :2], corners[:, 2:]))
        if round_ < _ROUNDS:
            sides = (high - low).clamp(min=1e-6)
            zoom = (size[0] * size[1] / sides.prod(1)).sqrt() if isinstance(size, tuple) else size / sides.amax(1)
            placed[:, 2] = (placed[:, 2] / zoom).clamp(min=1.0)
        placed[:, 4:] = placed[:, 4:] - (low + high) / 2
    return placed


@compiled
def _bounds(points: Any, turns: Any, distances: Any, focal: float, found: Any) -> None:
    """The boxes around points (N, 3) at poses, relative to the principal point: x0, y0, x1, y1, (B, 4)."""
    for b in range(turns.shape[0]):
        turn, distance = turns[b], distances[b]
        x0 = y0 = np.inf
        x1 = y1 = -np.inf
        for n in range(points.shape[0]):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            inverse = focal / (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + distance)
            across = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z) * inverse
            down = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z) * inverse
            x0, x1 = min(x0, across), max(x1, across)
            y0, y1 = min(y0, down), max(y1, down)
        found[b, 0], found[b, 1], found[b, 2], found[b, 3] = x0, y0, x1, y1
