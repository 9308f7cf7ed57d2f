"""Mesh simplification, for images too small to show every face."""

from __future__ import annotations

import math
from ctypes import c_double, c_int64

import numpy as np
import torch
from numpy.typing import NDArray

from .. import native
from .mesh import Mesh, distinct
from .topology import weld_vertices

_DOUBLES, _INDICES = native.array(np.float64), native.array(np.int64)
_collapse = native.function("collapse", _DOUBLES, c_int64, _INDICES, c_int64, c_double, _INDICES)


def simplify(mesh: Mesh, tolerance: float) -> Mesh:
    """Collapses edges, the shortest first, as long as no vertex moves by more than ``tolerance``.

    Faces that become lines, or equal to others, are dropped; a mesh that would lose all faces is returned as it is.
    Parts thinner than ``tolerance`` may become flat, but parts that no edge joins stay apart.

    Args:
        mesh: on the CPU.
        tolerance: in units of the mesh.
    """
    places = mesh.vertices.numpy()
    faces = weld_vertices(places)[mesh.faces.numpy()]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    order = np.argsort(length, kind="stable")
    faces = collapse_edges(places, ends[order[length[order] <= tolerance]], tolerance)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = faces[np.sort(distinct(np.sort(faces, axis=1))[0])]
    if not len(faces):
        return mesh
    vertices, numbers = np.unique(faces, return_inverse=True)
    used = torch.from_numpy(vertices)
    return Mesh(mesh.vertices[used], torch.from_numpy(numbers.reshape(-1, 3)), mesh.brightness[used])


def collapse_edges(places: NDArray[np.float64], ends: NDArray[np.int64], tolerance: float) -> NDArray[np.int64]:
    """Merges the two vertices of each edge, one edge after the other, unless a vertex would move farther than allowed.

    Args:
        places: (V, 3).
        ends: (E, 2), edges in the order to collapse them.
        tolerance: how far a vertex may move.

    Returns:
        (V,), the vertex that each is merged with.
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
