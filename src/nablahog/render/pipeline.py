"""The rendering in PyTorch, on any device, differentiable in everything; the native loops are tested against it.

Projection, rasterisation and anti-aliasing are modules of their own; clipping and shading are here.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from . import edge_gradient, opendr
from .camera import Camera, to_camera, to_screen
from .mesh import Mesh
from .rasterize import barycentric, normalize_weights, rasterize
from .topology import Edges

NEAR = 1e-3
"""Depth of the near plane, as a share of the camera's distance from the object."""


class Clipped(NamedTuple):
    """The part of a mesh in front of the near plane.

    Attributes:
        points: (V', 3) in the camera frame: the mesh's own, and the new ones on the plane.
        faces: (F', 3), none of them with a corner behind the plane.
        brightness: (F', 3), at the corners of each face.
    """

    points: Tensor
    faces: Tensor
    brightness: Tensor


def clip(points: Tensor, faces: Tensor, brightness: Tensor, near: float) -> Clipped:
    """Clips triangles at depth ``near``; differentiable in ``points`` (V, 3) and ``brightness`` (F, 3).

    A triangle with one corner in front stays one triangle, one with two corners in front becomes two.
    """
    front = points[:, 2] > near
    inside = front[faces].sum(1)
    parts = [(faces[inside == 3], brightness[inside == 3])]
    new_points = [points]
    count = len(points)
    for number in (1, 2):
        which = (inside == number).nonzero().squeeze(1)
        # the odd corner, alone in front or alone behind, comes first
        odd = (front[faces[which]] == (number == 1)).int().argmax(1)
        order = (odd[:, None] + torch.arange(3, device=faces.device)) % 3
        corner, bright = faces[which].gather(1, order), brightness[which].gather(1, order)
        cuts, shades = [], []
        for other in (1, 2):
            # from front to back, so that two triangles cut their common edge at the very same point
            a, b = (0, other) if number == 1 else (other, 0)
            start, end = points[corner[:, a]], points[corner[:, b]]
            t = (near - start[:, 2:]) / (end[:, 2:] - start[:, 2:])
            place = torch.lerp(start[:, :2], end[:, :2], t)
            new_points.append(torch.cat([place, torch.full_like(t, near)], 1))  # rounding puts none behind the plane
            cuts.append(count + torch.arange(len(which), device=faces.device))
            shades.append(torch.lerp(bright[:, a], bright[:, b], t[:, 0]))
            count += len(which)
        if number == 1:
            parts.append((torch.stack([corner[:, 0], *cuts], 1), torch.stack([bright[:, 0], *shades], 1)))
        else:
            for triangle, shade in (
                ((corner[:, 1], corner[:, 2], cuts[0]), (bright[:, 1], bright[:, 2], shades[0])),
                ((corner[:, 2], cuts[1], cuts[0]), (bright[:, 2], shades[1], shades[0])),
            ):
                parts.append((torch.stack(triangle, 1), torch.stack(shade, 1)))
    return Clipped(torch.cat(new_points), *(torch.cat(part) for part in zip(*parts, strict=True)))


def clip_to_view(points: Tensor, faces: Tensor, brightness: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Clips a mesh at the near plane of a camera.

    Args:
        points: (1, V, 3) in the camera frame.
        faces, brightness: (F, 3), the latter at the corners of each face.
        distance: (1,), from the camera to the object.

    Returns:
        Points, faces and brightness of the part in front, in the same form.
    """
    near = NEAR * float(distance.detach())
    if bool((points[..., 2] > near).all()):
        return points, faces, brightness
    part = clip(points[0], faces, brightness, near)
    return part.points[None], part.faces, part.brightness


def together(cut: Tensor) -> tuple[list[Tensor], Tensor]:
    """Groups of views that can be drawn together: all that the near plane does not cut, and each other view alone.

    Args:
        cut: (B,), whether a view is.

    Returns:
        The indices of each group, and the position of each view in the concatenated groups, (B,).
    """
    whole, alone = (~cut).nonzero().squeeze(1), cut.nonzero().squeeze(1)
    groups = [group for group in (whole, *torch.split(alone, 1)) if len(group)]
    return groups, torch.cat(groups).argsort()


def render_torch(
    mesh: Mesh,
    brightness: Tensor,
    edges: Edges,
    poses: Tensor,
    camera: Camera,
    background: Tensor,
    step: int,
    method: str,
    by_motion: bool = False,
) -> Tensor:
    """Images (B, 1, H, W) of a mesh at poses (B, 6) over backgrounds (1 or B, H, W), which decide the dtype.

    Where several edges meet in a pixel their areas may add up to more than it has: images may leave 0…1.

    Args:
        mesh: its vertices and faces.
        brightness: (F, 3), at the corners of each face.
        edges: of the mesh.
        poses, camera, background: the view.
        step: samples of a pixel along a side.
        method: "edges" or "opendr".
        by_motion: whether four more channels are wanted, the screen gradient of :class:`.rendering.Rendering`.
    """
    points, faces = to_camera(mesh.vertices, poses), mesh.faces
    near = (1 - 1e-6) * NEAR * poses.detach()[:, None, 2:3]
    if len(poses) == 1:
        points, faces, brightness = clip_to_view(points, faces, brightness, poses[:, 2])
    elif bool((cut := (points[..., 2:] <= near).flatten(1).any(1)).any()):
        groups, order = together(cut)
        behind = background.expand(len(poses), -1, -1)
        images = [
            render_torch(mesh, brightness, edges, poses[g], camera, behind[g], step, method, by_motion) for g in groups
        ]
        return torch.cat(images)[order]
    beside = points[..., 2:].abs() < 1e-3 * near  # not drawn, but 1 / depth could be infinite and have no derivative
    screen = to_screen(torch.where(beside, -1.0, points), poses, camera)
    screen = torch.cat([screen[..., :2] * step, screen[..., 2:]], dim=-1).to(background.dtype)

    ids, inverse = rasterize(screen, faces, camera.height * step, camera.width * step)
    samples = _shade(ids, screen, faces, brightness, background.expand(len(poses), -1, -1), step)
    crossings = edge_gradient.edge_crossings(screen, edges, ids, inverse)
    if method == "opendr":
        silhouette = edge_gradient.silhouette_edges(screen.detach(), edges)
        drawn, (inverse, samples, ids) = opendr.draw_silhouettes(crossings, silhouette, inverse, samples, ids)

    def moved_by(motion: Tensor) -> Tensor:
        if method == "edges":
            return edge_gradient.antialias(samples, ids, inverse, crossings, screen, motion, edges, faces, step)
        return opendr.resolve(samples, ids, drawn, screen, motion, faces, step)

    image = moved_by(screen - screen.detach())  # the motion is 0; only its derivative matters
    if not by_motion:
        return image[:, None]
    w = screen[..., 2:]
    zero, one = torch.zeros_like(w), torch.full_like(w, step)
    motions = [one, zero, zero], [step * w, zero, zero], [zero, one, zero], [zero, step * w, zero]
    return torch.stack([image, *(moved_by(torch.cat(each, 2)) - image for each in motions)], 1)


def _shade(ids: Tensor, screen: Tensor, faces: Tensor, brightness: Tensor, background: Tensor, step: int) -> Tensor:
    """Brightness of the samples (B, H · step, W · step): perspective-correct between the corners of each triangle."""
    samples = background.repeat_interleave(step, 1).repeat_interleave(step, 2)
    place = (ids >= 0).nonzero(as_tuple=True)
    face = ids[place]
    at = screen.detach()[place[0][:, None], faces[face]]
    weights = barycentric(at, faces[face], place[2] + 0.5, place[1] + 0.5) * at[..., 2]
    weights = normalize_weights(weights.clamp(min=0))[:, 1:]
    bright = brightness[face].to(samples)
    first = bright[:, :1]  # keeps a face of one brightness exactly so
    return samples.index_put(place, (first + (weights * (bright[:, 1:] - first)).sum(1, keepdim=True)).squeeze(1))
