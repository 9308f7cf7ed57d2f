"""The rendering in plain PyTorch, on any device."""

from __future__ import annotations

import torch
from torch import Tensor

from . import edges as by_edges
from . import opendr
from .camera import Camera, to_camera, to_screen
from .clip import NEAR, clip
from .mesh import Mesh
from .rasterize import barycentric, normalized, visibility
from .topology import Edges


def in_front(points: Tensor, faces: Tensor, corners: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Points (1, V, 3) in the camera frame, faces (F, 3) and brightness at their corners, all cut at the near plane of
    a camera at ``distance`` (1,) from the object."""
    near = NEAR * float(distance.detach())
    if bool((points[..., 2] > near).all()):
        return points, faces, corners
    cut = clip(points[0], faces, corners, near)
    return cut.points[None], cut.faces, cut.corners


def render_steps(
    mesh: Mesh, corners: Tensor, edges: Edges, poses: Tensor, camera: Camera, background: Tensor, step: int, method: str
) -> Tensor:
    """Images (B, H, W) of a mesh at poses (B, 6) before backgrounds (1 or B, H, W), which decide the dtype.

    Args:
        corners: (F, 3), brightness at the corners of each face.
        step: samples of a pixel along a side.
        method: "edges" or "opendr".
    """
    points, faces = to_camera(mesh.vertices, poses), mesh.faces
    near = (1 - 1e-6) * NEAR * poses.detach()[:, None, 2:3]
    if len(poses) == 1:
        points, faces, corners = in_front(points, faces, corners, poses[:, 2])
    elif bool((points[..., 2:] <= near).any()):  # each is cut in its own way
        each = zip(torch.split(poses, 1), torch.split(background.expand(len(poses), -1, -1), 1), strict=True)
        images = [render_steps(mesh, corners, edges, pose, camera, behind, step, method) for pose, behind in each]
        return torch.cat(images)
    beside = points[..., 2:].abs() < 1e-3 * near  # is not drawn, but its 1 / depth might be infinite, and have no slope
    screen = to_screen(torch.where(beside, -1.0, points), poses, camera)
    screen = torch.cat([screen[..., :2] * step, screen[..., 2:]], dim=-1).to(background.dtype)

    ids, inverse = visibility(screen, faces, camera.height * step, camera.width * step)
    behind = background.expand(len(poses), -1, -1)
    samples = behind.repeat_interleave(step, 1).repeat_interleave(step, 2)
    place = (ids >= 0).nonzero(as_tuple=True)
    face = ids[place]
    at = screen.detach()[place[0][:, None], faces[face]]
    weights = barycentric(at, faces[face], place[2] + 0.5, place[1] + 0.5) * at[..., 2]
    weights = normalized(weights.clamp(min=0))[:, 1:]
    bright = corners[face].to(samples)
    first = bright[:, :1]  # so that a face of one brightness is exactly of one brightness
    samples = samples.index_put(place, (first + (weights * (bright[:, 1:] - first)).sum(1, keepdim=True)).squeeze(1))

    found = by_edges.crossings(screen, edges, ids, inverse)
    if method == "edges":
        image = by_edges.blend(samples, ids, inverse, found, screen, edges, faces, step)
    else:
        outline = by_edges.outlines(screen.detach(), edges)
        on_outline, (inverse, samples, drawn) = opendr.overdraw(found, outline, inverse, samples, ids)
        image = opendr.blend(samples, drawn, on_outline, screen, faces, step)
    # where several edges meet in a pixel their shares may add up to more than it has; the derivative stays
    return image - (image - image.clamp(0, 1)).detach()
