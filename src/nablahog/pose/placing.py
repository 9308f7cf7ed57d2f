"""Where an object must be for its outline to fill a given box: distance and shift, whatever side it is seen from."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from ..render import Camera, Mesh
from ..render.camera import to_camera, to_screen

_ROUNDS = 3  # perspective makes the size no exact inverse of the distance; twice is within a tenth of a pixel


def hull(mesh: Mesh) -> Tensor:
    """The vertices (N, 3) that alone decide the box around any view of a mesh."""
    points = mesh.vertices.detach().cpu().numpy()
    try:
        return torch.from_numpy(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # in one plane, or too few
        return torch.from_numpy(np.unique(points, axis=0))


def place(poses: Tensor, points: Tensor, camera: Camera, size: tuple[float, float]) -> Tensor:
    """``poses`` (B, 6) with distance, x and y such that the box around ``points`` has the area of one of ``size``
    (width, height), and its middle in the middle of the image."""
    placed = poses.clone()
    for _ in range(_ROUNDS):
        screen = to_screen(to_camera(points, placed), placed, camera)[..., :2]
        low, high = screen.amin(1), screen.amax(1)
        extent = (high - low).clamp(min=1e-6)
        zoom = (size[0] * size[1] / extent.prod(1)).sqrt()
        placed[:, 2] = (placed[:, 2] / zoom).clamp(min=1.0)
        placed[:, 4:] = placed[:, 4:] + _middle(camera) - (low + high) / 2
    screen = to_screen(to_camera(points, placed), placed, camera)[..., :2]
    placed[:, 4:] = placed[:, 4:] + _middle(camera) - (screen.amin(1) + screen.amax(1)) / 2
    return placed


def _middle(camera: Camera) -> Tensor:
    return torch.tensor([camera.width / 2, camera.height / 2], dtype=torch.float64)
