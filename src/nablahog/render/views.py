"""What else than brightness can be seen of a mesh: its silhouette, and depths and normals of its surface."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .camera import Camera, check_poses, to_camera, to_screen
from .mesh import Mesh
from .rasterize import visibility
from .renderer import SUPERSAMPLING, render
from .shading import Light
from .steps import in_front


def silhouette(mesh: Mesh, poses: Tensor, camera: Camera, *, supersampling: int = SUPERSAMPLING) -> Tensor:
    """The share of each pixel that the object covers, (B, 1, H, W) in 0…1, float32; arguments, derivatives and errors
    as of :func:`.renderer.render`."""
    white = Mesh(mesh.vertices, mesh.faces, torch.ones_like(mesh.brightness))
    everywhere = Light(ambient=1.0, diffuse=0.0)
    return render(white, poses, camera, background=0.0, light=everywhere, supersampling=supersampling)


def depth_and_normals(mesh: Mesh, poses: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """What is seen at the middle of each pixel: its depth along the optical axis and the surface's normal.

    Args:
        mesh, poses, camera: as of :func:`.renderer.render`.

    Returns:
        Depths (B, H, W), infinite where nothing is seen, and unit normals (B, 3, H, W) of the triangles in the camera
        frame (x right, y down, z forward) that look towards the camera, 0 where nothing is seen.  Both are float64,
        and constants to any differentiation.

    Raises:
        ValueError: ``poses`` is no finite (B, 6) tensor with distances above 0.
    """
    check_poses(poses)
    found = []
    with torch.no_grad():
        for pose in torch.split(poses.double(), 1):
            points, faces, _ = in_front(
                to_camera(mesh.vertices, pose), mesh.faces, mesh.brightness[mesh.faces], pose[:, 2]
            )
            ids, inverse = visibility(to_screen(points, pose, camera), faces, camera.height, camera.width)
            a, b, c = points[0][faces].unbind(1)
            normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1, eps=1e-300)
            away = (normals * a).sum(1, keepdim=True) > 0
            normals = torch.where(away, -normals, normals)
            seen = ids >= 0
            normal = normals.new_zeros((*ids.shape, 3))
            normal[seen] = normals[ids[seen]]
            found.append((torch.where(seen, 1 / inverse, math.inf), normal.permute(0, 3, 1, 2)))
    depths, directions = zip(*found, strict=True)
    return torch.cat(depths), torch.cat(directions)
