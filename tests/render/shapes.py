"""Small meshes to render, and cameras to see them with."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import torch
from torch import Tensor

from nablahog.render import Camera, Light, Mesh

CAMERA = Camera.from_field_of_view(10, 48, 40)
"""From 13 units away it sees a box of 1 unit on half of the image, with little perspective."""
FLAT = Light(ambient=1.0, diffuse=0.0)
"""Everything is as bright as its albedo."""
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def mesh(
    vertices: Sequence[Sequence[float]] | Tensor,
    faces: Sequence[Sequence[int]] | Tensor,
    brightness: float | Sequence[float] = 0.8,
) -> Mesh:
    vertices = torch.as_tensor(vertices, dtype=torch.float64)
    albedo = torch.as_tensor(brightness, dtype=torch.float64).expand(len(vertices)).clone()
    return Mesh(vertices, torch.as_tensor(faces), albedo)


def quads(faces: Sequence[Sequence[int]]) -> list[tuple[int, int, int]]:
    return [triangle for a, b, c, d in faces for triangle in ((a, b, c), (a, c, d))]


def box(size: tuple[float, float, float] = (1, 1, 1), brightness: float = 0.8) -> Mesh:
    """Centred at 0; vertex 4 i + 2 j + k is at the i-th x, j-th y and k-th z."""
    x, y, z = (side / 2 for side in size)
    vertices = [(i, j, k) for i in (-x, x) for j in (-y, y) for k in (-z, z)]
    return mesh(vertices, quads(QUADS), brightness)


def cylinder(sides: int, *, caps: bool = True) -> Mesh:
    """Upright, of radius ½ and height 1; side k starts at the angle 2 π k / sides."""
    angles = [2 * math.pi * k / sides for k in range(sides)]
    vertices = [(math.cos(a) / 2, math.sin(a) / 2, z) for z in (-0.5, 0.5) for a in angles]
    faces = quads([(k, (k + 1) % sides, sides + (k + 1) % sides, sides + k) for k in range(sides)])
    if caps:
        faces += [(start, start + k, start + k + 1) for start in (0, sides) for k in range(1, sides - 1)]
    return mesh(vertices, faces)


def joined(*meshes: Mesh) -> Mesh:
    faces, count = [], 0
    for one in meshes:
        faces.append(one.faces + count)
        count += len(one.vertices)
    return Mesh(
        torch.cat([one.vertices for one in meshes]), torch.cat(faces), torch.cat([one.brightness for one in meshes])
    )


def split(one: Mesh) -> Mesh:
    """The same triangles, each with three vertices of its own."""
    corners = one.faces.flatten()
    return Mesh(one.vertices[corners], torch.arange(len(corners)).reshape(-1, 3), one.brightness[corners])


def flipped(one: Mesh, seed: int = 0) -> Mesh:
    """Some of the triangles the other way round."""
    chosen = torch.rand(len(one.faces), generator=torch.Generator().manual_seed(seed)) < 0.5
    return Mesh(one.vertices, torch.where(chosen[:, None], one.faces.flip(1), one.faces), one.brightness)


def upright(
    pixels: Sequence[tuple[float, float]], camera: Camera, distance: float, y: float = 0.0
) -> list[list[float]]:
    """Points in the plane of that y which a camera straight in front, at ``distance``, sees at ``pixels`` (x, y)."""
    scale = (distance + y) / camera.focal
    return [[(u - camera.width / 2) * scale, y, (camera.height / 2 - v) * scale] for u, v in pixels]


def rectangle(
    left: float, top: float, right: float, bottom: float, camera: Camera, distance: float = 3.0, brightness: float = 0.8
) -> Mesh:
    """What fills these pixels for a camera straight in front."""
    corners = upright([(left, top), (right, top), (right, bottom), (left, bottom)], camera, distance)
    return mesh(corners, quads([(0, 1, 2, 3)]), brightness)


def poses(count: int, distance: float, seed: int = 0) -> Tensor:
    """Any azimuth, elevations up to 60°, and a little of all else."""
    random = torch.rand(count, 6, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    low = torch.tensor([0.0, -20, distance, -10, -2, -2], dtype=torch.float64)
    high = torch.tensor([360.0, 60, distance * 1.1, 10, 2, 2], dtype=torch.float64)
    return low + random * (high - low)


def by_opencv(points: Tensor, matrix: Tensor, intrinsics: Tensor) -> Tensor:
    """Where OpenCV sees points (N, 3) after a rigid motion (4, 4), (N, 2), pixels."""
    turn, _ = cv2.Rodrigues(matrix[:3, :3].numpy())
    seen, _ = cv2.projectPoints(points.numpy(), turn, matrix[:3, 3].numpy(), intrinsics.numpy(), np.zeros(4))
    return torch.from_numpy(seen[:, 0])
