"""What is seen at each sample: clipping, the nearest triangle (in C++ on a CPU, in PyTorch elsewhere), its normal."""

from __future__ import annotations

import math
from ctypes import c_bool, c_int64

import numpy as np
import torch
from torch import Tensor

from .. import native
from .camera import Camera, check_camera, check_poses, to_camera, to_screen
from .mesh import Mesh, check_mesh

NEAR = 1e-3
"""Depth of the near plane, as a share of the camera's distance from the object."""
_INTEGERS, _REALS = native.array(np.int32), native.array(np.float32, np.float64)
_FLAT_MESH = _REALS, c_int64, c_int64, _INTEGERS, c_int64
_rasterize = native.function("rasterize", c_bool, *_FLAT_MESH, c_int64, c_int64, _INTEGERS, _REALS)
_CHUNK = 2**22  # samples in bounding boxes of triangles that are tested group_cut_views


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Finds the nearest triangle at each sample.

    A sample on the common edge of two triangles belongs to both; of triangles at equal depth the first is visible.
    Triangles with a corner behind the camera (1 / depth ≤ 0) are not drawn: clip them first, :func:`clip`.

    Args:
        screen: (B, V, 3), float32 or float64: x and y in samples, sample (row i, column j) being at (j + ½, i + ½), and
            1 / depth.
        faces: (F, 3), int64 into the points.
        height, width: samples.

    Returns:
        The triangle, int64, -1 where there is none, and 1 / depth, 0 where there is none; both (B, height, width).
        Neither is differentiable.
    """
    screen = screen.detach().contiguous()
    if not native.can_read(screen):
        return rasterize_torch(screen, faces, height, width)
    ids = torch.empty(len(screen), height, width, dtype=torch.int32, device=screen.device)
    inverse, triangles = screen.new_empty(ids.shape), faces.int().contiguous()
    mesh = screen, len(screen), screen.shape[1], triangles, len(triangles)
    _rasterize(screen.dtype == torch.float64, *mesh, height, width, ids, inverse)
    return ids.long(), inverse


def rasterize_torch(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """:func:`rasterize` in PyTorch, on any device."""
    corners = screen[:, faces]  # (B, F, 3, 3)
    low, high = corners[..., :2].amin(2), corners[..., :2].amax(2)
    limit = screen.new_tensor([width, height])
    first = (low - 0.5).ceil().clamp(min=0)
    count = ((high - 0.5).floor().minimum(limit - 1) - first + 1).clamp(min=0)
    drawn = (corners[..., 2] > 0).all(2) & torch.isfinite(corners).all(3).all(2)
    boxes = torch.where(drawn, count.prod(2), 0).nan_to_num(0).long().flatten()
    listed = boxes.nonzero().squeeze(1)
    total = boxes[listed].cumsum(0)
    nothing = len(faces)
    ids = torch.full((len(screen) * height * width,), nothing, dtype=torch.int64, device=screen.device)
    inverse = screen.new_zeros(len(ids))
    start = 0
    while start < len(listed):
        done = int(total[start - 1]) if start else 0
        stop = max(start + 1, int(torch.searchsorted(total, done + _CHUNK)))
        chunk = listed[start:stop]
        which = chunk.repeat_interleave(boxes[chunk])
        number = torch.arange(len(which), device=screen.device) - (
            total[start:stop] - boxes[chunk] - done
        ).repeat_interleave(boxes[chunk])
        batch, face = which // len(faces), which % len(faces)
        across = count[batch, face, 0].long()
        x = first[batch, face, 0] + number % across + 0.5
        y = first[batch, face, 1] + number // across + 0.5
        weights = barycentric(corners[batch, face], faces[face], x, y)
        inside = (weights >= 0).all(1)  # false for triangles of no area, whose weights are NaN
        batch, face, x, y, weights = (part[inside] for part in (batch, face, x, y, weights))
        w = corners[batch, face, :, 2]
        w = (weights * w).sum(1).maximum(w.amin(1)).minimum(w.amax(1))  # rounding must not decide who is first
        place = (batch * height + y.long()) * width + x.long()
        nearer = inverse.scatter_reduce(0, place, w, "amax")
        ids[nearer > inverse] = nothing
        best = w == nearer[place]
        ids.scatter_reduce_(0, place[best], face[best], "amin")
        inverse = nearer
        start = stop
    ids[ids == nothing] = -1
    return ids.reshape(-1, height, width), inverse.reshape(-1, height, width)


def barycentric(corners: Tensor, faces: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Screen-space barycentric coordinates (N, 3) of points x, y (N,) in triangles with corners (N, 3, ≥ 2).

    Edges go from the lower to the higher vertex index in ``faces`` (N, 3): two triangles compute the same for theirs.
    """
    parts = []
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        swap = faces[:, a] > faces[:, b]
        p = torch.where(swap[:, None], corners[:, b, :2], corners[:, a, :2])
        q = torch.where(swap[:, None], corners[:, a, :2], corners[:, b, :2])
        cross = (q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
        parts.append(torch.where(swap, -cross, cross))
    weights = torch.stack(parts, 1)
    return weights / weights.sum(1, keepdim=True)


def normalize_weights(weights: Tensor) -> Tensor:
    """Scales weights (N, 3) to a sum of 1.  Weights without a sum, as of triangles of no area, become 1/3."""
    return (weights / weights.sum(1, keepdim=True)).nan_to_num(1 / 3)


def clip(points: Tensor, faces: Tensor, brightness: Tensor, near: float) -> tuple[Tensor, Tensor, Tensor]:
    """Clips triangles at depth ``near``; differentiable in ``points`` (V, 3) and ``brightness`` (F, 3) of the corners.

    A triangle with one corner in front stays one triangle, one with two corners in front becomes two.  Points on the
    plane are added to those that there are.
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
    faces, brightness = (torch.cat(part) for part in zip(*parts, strict=True))
    return torch.cat(new_points), faces, brightness


def clip_to_view(points: Tensor, faces: Tensor, brightness: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """:func:`clip` of points (1, V, 3) at the near plane of a camera at a distance (1,) from the object."""
    near = NEAR * float(distance.detach())
    if bool((points[..., 2] > near).all()):
        return points, faces, brightness
    front, faces, brightness = clip(points[0], faces, brightness, near)
    return front[None], faces, brightness


def group_cut_views(cut: Tensor) -> tuple[list[Tensor], Tensor]:
    """Groups of views that can be drawn together: all that the near plane does not cut (B,), and each other one alone.

    Returns the indices of each group, and the position of each view in the concatenated groups, (B,).
    """
    whole, alone = (~cut).nonzero().squeeze(1), cut.nonzero().squeeze(1)
    groups = [group for group in (whole, *torch.split(alone, 1)) if len(group)]
    return groups, torch.cat(groups).argsort()


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
    check_camera(camera)
    poses = poses.double()
    with torch.no_grad():
        points = to_camera(check_mesh(mesh).vertices, poses)
        cut = (points[..., 2] <= NEAR * poses[:, 2:3]).any(1)
        groups, order = group_cut_views(cut)
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
