"""Clipping of triangles at the near plane: what is behind the camera cannot be projected."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

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
