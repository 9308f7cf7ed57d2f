"""The surface of a mesh: its edges, its brightness under a light, and simplification.

Simplified meshes are for images too small to show every face.
"""

from __future__ import annotations

import math
from ctypes import c_double, c_int64
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .. import native
from ..inputs.numbers import as_number, as_numbers
from ..inputs.tensors import read_tensor
from .mesh import Mesh
from .soup import find_distinct

_DOUBLES, _INDICES = native.array(np.float64), native.array(np.int64)
_collapse = native.function("collapse", _DOUBLES, c_int64, _INDICES, c_int64, c_double, _INDICES)

CREASE_ANGLE = 30.0
"""Degrees between two faces above which their edge is a crease; below, the faces approximate a smooth surface."""
_CREASE_COSINE = math.cos(math.radians(CREASE_ANGLE)) - 1e-9  # the sides of a twelve-gon meet at 30 degrees exactly
_MAX_FACES_AT_VERTEX = 64  # at a vertex, to be smoothed: the number of pairs grows quadratically

SMOOTH, BOUNDARY, CREASE = 0, 1, 2
"""Kinds of edges: between two faces of a smooth surface; of one face, or of more than two; a crease."""


class Edges(NamedTuple):
    """The edges of a mesh that can be visible: all but those inside a plane."""

    ends: Tensor  # (E, 2), int64 into the mesh's vertices
    opposite: Tensor  # (E, 2), int64: the third corners of the two faces; twice the same where there is one face
    kind: Tensor  # (E,), int64, one of :data:`SMOOTH`, :data:`BOUNDARY`, :data:`CREASE`


def weld_vertices(places: NDArray[np.float64]) -> NDArray[np.int64]:
    """The first vertex at the same place, for each of (V, 3): colours split vertices, but not the surface."""
    first, which = find_distinct(places)
    return first[which]


def mesh_edges(mesh: Mesh) -> Edges:
    """Finds the edges of a mesh and their kinds; triangles with two corners at one place have none."""
    places = read_tensor("vertices", mesh.vertices)
    a, b, c = weld_vertices(places)[read_tensor("faces", mesh.faces)].T
    proper = (a != b) & (b != c) & (c != a)
    a, b, c = a[proper], b[proper], c[proper]
    start, end, opposite = np.concatenate([a, b, c]), np.concatenate([b, c, a]), np.concatenate([c, a, b])
    key = np.maximum(start, end) * len(places) + np.minimum(start, end)
    order = np.argsort(key, kind="stable")
    key, opposite = key[order], opposite[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    counts = np.diff(starts, append=len(key))
    second = np.where(counts > 1, starts + 1, starts)
    ends = np.stack([key[starts] % len(places), key[starts] // len(places)], axis=1)
    opposite = np.stack([opposite[starts], opposite[second]], axis=1)

    base = places[ends[:, 0]]
    along = places[ends[:, 1]] - base
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    away = places[opposite] - base[:, None]
    away -= (away * along[:, None]).sum(axis=2, keepdims=True) * along[:, None]
    away /= np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-300)
    straight = -(away[:, 0] * away[:, 1]).sum(axis=1)  # cosine of the angle between the faces: 1 in a plane
    kind = np.where(straight < _CREASE_COSINE, CREASE, SMOOTH)
    kind[counts != 2] = BOUNDARY
    bent = (kind != SMOOTH) | (straight < 1 - 1e-9)
    device = mesh.vertices.device
    return Edges(*(torch.from_numpy(array[bent]).to(device) for array in (ends, opposite, kind)))


def face_planes(vertices: NDArray[np.float64], edges: Edges) -> NDArray[np.float32]:
    """(2, 4, E): of the planes of both faces at each edge, unit normal n and n·x on it; 0 for faces of no area."""
    ends, opposite, _ = (part.numpy() for part in edges)
    base = vertices[ends[:, :1]]
    along, across = vertices[ends[:, 1:]] - base, vertices[opposite] - base
    normal = np.cross(along, across)
    size = np.linalg.norm(normal, axis=2, keepdims=True)
    proper = size > 1e-12 * np.linalg.norm(along, axis=2, keepdims=True) * np.linalg.norm(across, axis=2, keepdims=True)
    normal = np.where(proper, normal / np.where(proper, size, 1), 0)
    planes = np.concatenate([normal, (normal * base).sum(axis=2, keepdims=True)], axis=2)
    return np.ascontiguousarray(planes.transpose(1, 2, 0), dtype=np.float32)


class SmoothingGroups(NamedTuple):
    """The faces whose normals add up at each corner.

    Entry k adds ``sign[k]`` times the normal of ``face[k]`` to ``corner[k]``.  There are 3 F corners: 3 f + i is the
    i-th corner of face f.
    """

    corner: Tensor
    face: Tensor
    sign: Tensor


def smoothing_groups(mesh: Mesh) -> SmoothingGroups:
    """Groups the faces around each corner that meet its own face at :data:`CREASE_ANGLE` or less, turned either way."""
    places, faces = read_tensor("vertices", mesh.vertices), read_tensor("faces", mesh.faces)
    a, b, c = places[faces[:, 0]], places[faces[:, 1]], places[faces[:, 2]]
    normal = np.cross(b - a, c - a)
    vertex = weld_vertices(places)[faces].ravel()
    corner = np.argsort(vertex, kind="stable")  # the corners at a vertex follow each other
    vertex, face = vertex[corner], corner // 3
    unit = (normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))[face]
    groups = [(corner, face, np.ones(len(corner)))]
    sizes = np.bincount(vertex)[vertex]
    first = np.flatnonzero((sizes > 1) & (sizes <= _MAX_FACES_AT_VERTEX))
    for offset in range(1, _MAX_FACES_AT_VERTEX):  # pairs of a corner and the one so many after it
        first = first[first + offset < len(corner)]
        first = first[vertex[first] == vertex[first + offset]]
        if not len(first):
            break
        cosine = (unit[first] * unit[first + offset]).sum(axis=1)
        joined = np.abs(cosine) >= _CREASE_COSINE
        before, after, sign = first[joined], first[joined] + offset, np.sign(cosine[joined])
        groups += [(corner[before], face[after], sign), (corner[after], face[before], sign)]
    device = mesh.vertices.device
    return SmoothingGroups(*(torch.from_numpy(np.concatenate(part)).to(device) for part in zip(*groups, strict=True)))


def face_normals(mesh: Mesh) -> Tensor:
    """(F, 3): perpendicular to each face, as long as twice its area; differentiable in the vertices."""
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    normals: Tensor = torch.linalg.cross(b - a, c - a)
    return normals


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
        object.__setattr__(self, "direction", as_numbers("the light's direction", self.direction, "x, y, z"))
        if not 0 < math.hypot(*self.direction) < math.inf:
            raise ValueError(f"the light's direction must have a length above 0, got {self.direction}")
        for name in ("ambient", "diffuse"):
            object.__setattr__(self, name, as_number(f"{name} light", getattr(self, name), 0, 1))
        if self.ambient + self.diffuse > 1 + 1e-9:
            raise ValueError(
                f"ambient and diffuse light must be at most 1 together, got {self.ambient:g} and {self.diffuse:g}"
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
    direction = mesh.vertices.new_tensor([part / length for part in light.direction])
    lit = (corner_normals(mesh, groups) @ direction).abs()
    brightness: Tensor = mesh.brightness[mesh.faces] * (light.ambient + light.diffuse * lit)
    return brightness


def simplify(mesh: Mesh, tolerance: float) -> Mesh:
    """Collapses edges, the shortest first, as long as no vertex moves by more than ``tolerance``; on the CPU.

    Faces that become lines, or equal to others, are dropped; a mesh that would lose all faces is returned as it is.
    Parts thinner than ``tolerance`` may become flat, but parts that no edge joins stay apart.
    """
    places = mesh.vertices.numpy()
    faces = weld_vertices(places)[mesh.faces.numpy()]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    order = np.argsort(length, kind="stable")
    faces = collapse_edges(places, ends[order[length[order] <= tolerance]], tolerance)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = faces[np.sort(find_distinct(np.sort(faces, axis=1))[0])]
    if not len(faces):
        return mesh
    vertices, numbers = np.unique(faces, return_inverse=True)
    used = torch.from_numpy(vertices)
    return Mesh(mesh.vertices[used], torch.from_numpy(numbers.reshape(-1, 3)), mesh.brightness[used])


def collapse_edges(places: NDArray[np.float64], ends: NDArray[np.int64], tolerance: float) -> NDArray[np.int64]:
    """Merges both ends (E, 2) of one edge after the other, unless a vertex (V, 3) would move farther than allowed.

    Returns the vertex that each is merged with, (V,).
    """
    if native.available():
        merged = np.empty(len(places), np.int64)
        _collapse(np.ascontiguousarray(places), len(places), ends, len(ends), tolerance, merged)
        return merged
    parent = list(range(len(places)))  # a union-find forest
    radius = [0.0] * len(places)  # how far the vertices merged with each one have moved, at most

    def root(vertex: int) -> int:
        while parent[vertex] != vertex:
            vertex = parent[vertex]
        return vertex

    for edge in ends.tolist():
        a, b = sorted(map(root, edge), key=lambda vertex: -radius[vertex])
        moved = math.dist(places[a], places[b]) + radius[b]
        if a != b and moved <= tolerance:
            parent[b] = a
            radius[a] = max(radius[a], moved)
    return np.array([root(vertex) for vertex in range(len(places))], np.int64)
