"""Shading: per-vertex albedo A and a light to brightness at the corners of each triangle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .mesh import Mesh
from .topology import SmoothingGroups, face_normals


@dataclass(frozen=True)
class Light:
    """Lambertian shading by one directional light and ambient light.

    A surface of albedo A and unit normal n has the brightness A (ambient + diffuse · |n·l|).  The absolute value
    lights both sides of a face alike, since CAD models seldom say which one is outside.  The light moves with the
    object, so brightness does not depend on the pose.

    Attributes:
        direction: to the light in the object's frame, of any length above 0.  The default gives the front, the sides
            and the top of a box three different values, so that its creases show from every viewpoint.
        ambient, diffuse: 0 or more, at most 1 together.

    Raises:
        ValueError: one of these is otherwise.

    >>> from nablahog.render import Light, pose
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 32, 32)
    >>> light = Light((0, -1, 1), ambient=0.3, diffuse=0.7)  # from the front and above
    >>> nablahog.render(mesh, pose(azimuth=30, distance=3), camera, light=light).shape
    torch.Size([1, 1, 32, 32])
    """

    direction: tuple[float, float, float] = (1.0, -2.0, 3.0)
    ambient: float = 0.3
    diffuse: float = 0.7

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", tuple(self.direction))  # lists, too
        if len(self.direction) != 3 or not 0 < math.hypot(*self.direction) < math.inf:
            raise ValueError(f"the light's direction must be three finite numbers, not all 0, got {self.direction}")
        if not (self.ambient >= 0 and self.diffuse >= 0 and self.ambient + self.diffuse <= 1 + 1e-9):
            raise ValueError(
                f"ambient and diffuse light must be at least 0, and at most 1 together, "
                f"got {self.ambient} and {self.diffuse}"
            )


def corner_normals(mesh: Mesh, groups: SmoothingGroups) -> Tensor:
    """(F, 3, 3): unit normals at the corners of each face, averaged over its smoothing group."""
    flat = face_normals(mesh)
    parts = groups.sign[:, None] * flat[groups.face]
    summed = flat.new_zeros((3 * len(flat), 3)).index_add(0, groups.corner, parts)
    return torch.nn.functional.normalize(summed, dim=1, eps=1e-300).reshape(-1, 3, 3)


def corner_brightness(mesh: Mesh, groups: SmoothingGroups, light: Light) -> Tensor:
    """(F, 3) in 0…1: brightness at the corners of each face; differentiable in vertices and albedo."""
    length = math.hypot(*light.direction)
    direction = mesh.vertices.new_tensor([each / length for each in light.direction])
    lit = (corner_normals(mesh, groups) @ direction).abs()
    brightness: Tensor = mesh.brightness[mesh.faces] * (light.ambient + light.diffuse * lit)
    return brightness
