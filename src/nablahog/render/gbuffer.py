"""Images of a mesh other than its brightness: silhouette, depth and normals."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .camera import Camera, check_poses, to_camera, to_screen
from .mesh import Mesh
from .pipeline import NEAR, clip_to_view, together
from .rasterize import rasterize
from .renderer import SUPERSAMPLING, render
from .shading import Light


def silhouette(mesh: Mesh, poses: Tensor, camera: Camera, *, supersampling: int = SUPERSAMPLING) -> Tensor:
    """Coverage of each pixel by the object.

    Args:
        mesh, poses, camera, supersampling: as for :func:`.renderer.render`.

    Returns:
        (B, 1, H, W) in 0…1, float32; differentiable as an image of :func:`.renderer.render`.

    Raises:
        ValueError: as :func:`.renderer.render`.

    >>> from nablahog.render import pose, silhouette
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 64, 64)
    >>> coverage = silhouette(mesh, pose(azimuth=30, distance=3), camera)
    >>> coverage.shape, float(coverage.max())
    (torch.Size([1, 1, 64, 64]), 1.0)
    """
    white = Mesh(mesh.vertices, mesh.faces, torch.ones_like(mesh.brightness))
    everywhere = Light(ambient=1.0, diffuse=0.0)
    return render(white, poses, camera, background=0.0, light=everywhere, supersampling=supersampling)


def depth_and_normals(mesh: Mesh, poses: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """Depth and surface normal at the middle of each pixel; not differentiable.

    Args:
        mesh, poses, camera: as for :func:`.renderer.render`.

    Returns:
        Depths (B, H, W) along the optical axis in units of the mesh, infinite where there is no surface; and unit
        normals (B, 3, H, W) in the camera frame (x right, y down, z forward) that face the camera, 0 where there is no
        surface.  Both are float64.

    Raises:
        ValueError: ``poses`` is no finite (B, 6) tensor with distances above 0.

    >>> from nablahog.render import depth_and_normals, pose
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 64, 64)
    >>> depths, normals = depth_and_normals(mesh, pose(azimuth=30, distance=3), camera)
    >>> depths.shape, normals.shape, bool(depths.isinf().any())  # infinite where the background is seen
    (torch.Size([1, 64, 64]), torch.Size([1, 3, 64, 64]), True)
    """
    check_poses(poses)
    poses = poses.double()
    with torch.no_grad():
        points = to_camera(mesh.vertices, poses)
        cut = (points[..., 2] <= NEAR * poses[:, 2:3]).any(1)
        groups, order = together(cut)
        parts = [_depth_and_normals(mesh, points[group], poses[group], camera) for group in groups]
        depths, normals = (torch.cat(part)[order] for part in zip(*parts, strict=True))
    return depths, normals


def _depth_and_normals(mesh: Mesh, points: Tensor, poses: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """As :func:`depth_and_normals`, of points (B, V, 3) in the camera frame; of more than one view none is clipped."""
    faces = mesh.faces
    if len(poses) == 1:
        points, faces, _ = clip_to_view(points, faces, mesh.brightness[faces], poses[:, 2])
    ids, inverse = rasterize(to_screen(points, poses, camera), faces, camera.height, camera.width)
    place = (ids >= 0).nonzero(as_tuple=True)
    a, b, c = points[place[0][:, None], faces[ids[place]]].unbind(1)
    normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1, eps=1e-300)
    away = (normals * a).sum(1, keepdim=True) > 0
    image = normals.new_zeros((*ids.shape, 3)).index_put(place, torch.where(away, -normals, normals))
    return torch.where(ids >= 0, 1 / inverse, math.inf), image.permute(0, 3, 1, 2)
