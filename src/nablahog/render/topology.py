"""Topology of a mesh: its edges, and the smoothing groups of faces around each corner."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .mesh import Mesh, distinct

CREASE_ANGLE = 30.0
"""Degrees between two faces above which their edge is a crease; below, the faces approximate a smooth surface."""
_CREASE_COSINE = math.cos(math.radians(CREASE_ANGLE)) - 1e-9  # the sides of a twelve-gon meet at 30 degrees exactly
_MAX_FACES = 64  # at a vertex, to be smoothed: the number of pairs grows quadratically

SMOOTH, BOUNDARY, CREASE = 0, 1, 2
"""Kinds of edges: between two faces of a smooth surface; of one face, or of more than two; a crease."""


class Edges(NamedTuple):
    """The edges of a mesh that can be visible: all but those inside a plane.

    Attributes:
        ends: (E, 2), int64 into the mesh's vertices.
        opposite: (E, 2), int64: the third corners of the two faces; twice the same where there is one face.
        kind: (E,), int64, one of :data:`SMOOTH`, :data:`BOUNDARY`, :data:`CREASE`.
    """

    ends: Tensor
    opposite: Tensor
    kind: Tensor


def _values(tensor: Tensor) -> NDArray[Any]:
    """The numbers of a tensor, without its derivative: topology is not differentiable."""
    try:
        return tensor.numpy(force=True)
    except RuntimeError:  # inside a function transform tensors have numbers but show no memory
        return np.array(tensor.tolist())


def weld_vertices(places: NDArray[np.float64]) -> NDArray[np.int64]:
    """The first vertex at the same place, for each of (V, 3): colours split vertices, but not the surface."""
    first, which = distinct(places)
    return first[which]


def mesh_edges(mesh: Mesh) -> Edges:
    """Finds the edges of a mesh and their kinds; not differentiable.

    Triangles with two corners at one place have no edges.
    """
    places = _values(mesh.vertices)
    a, b, c = weld_vertices(places)[_values(mesh.faces)].T
    proper = (a != b) & (b != c) & (c != a)
    a, b, c = a[proper], b[proper], c[proper]
    one, other, opposite = np.concatenate([a, b, c]), np.concatenate([b, c, a]), np.concatenate([c, a, b])
    key = np.maximum(one, other) * len(places) + np.minimum(one, other)
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


class SmoothingGroups(NamedTuple):
    """The faces whose normals add up at each corner.

    Entry k adds ``sign[k]`` times the normal of ``face[k]`` to ``corner[k]``.  There are 3 F corners: 3 f + i is the
    i-th corner of face f.
    """

    corner: Tensor
    face: Tensor
    sign: Tensor


def smoothing_groups(mesh: Mesh) -> SmoothingGroups:
    """Groups the faces around each corner that meet its own face at :data:`CREASE_ANGLE` or less.

    The orientation of faces, the order of their corners, makes no difference.
    """
    places = _values(mesh.vertices)
    faces = _values(mesh.faces)
    a, b, c = places[faces[:, 0]], places[faces[:, 1]], places[faces[:, 2]]
    normal = np.cross(b - a, c - a)
    vertex = weld_vertices(places)[faces].ravel()
    corner = np.argsort(vertex, kind="stable")  # the corners at a vertex follow each other
    vertex, face = vertex[corner], corner // 3
    unit = (normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))[face]
    entries = [(corner, face, np.ones(len(corner)))]
    sizes = np.bincount(vertex)[vertex]
    first = np.flatnonzero((sizes > 1) & (sizes <= _MAX_FACES))
    for step in range(1, _MAX_FACES):  # pairs of a corner and the step-th after it
        first = first[first + step < len(corner)]
        first = first[vertex[first] == vertex[first + step]]
        if not len(first):
            break
        cosine = (unit[first] * unit[first + step]).sum(axis=1)
        joined = np.abs(cosine) >= _CREASE_COSINE
        one, other, sign = first[joined], first[joined] + step, np.sign(cosine[joined])
        entries += [(corner[one], face[other], sign), (corner[other], face[one], sign)]
    device = mesh.vertices.device
    return SmoothingGroups(*(torch.from_numpy(np.concatenate(part)).to(device) for part in zip(*entries, strict=True)))


def face_normals(mesh: Mesh) -> Tensor:
    """(F, 3): perpendicular to each face, as long as twice its area; differentiable in the vertices."""
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    normals: Tensor = torch.linalg.cross(b - a, c - a)
    return normals
