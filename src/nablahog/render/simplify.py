"""Mesh simplification, for images too small to show every face."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from ..runtime.compile import compiled
from .mesh import Mesh, distinct
from .topology import weld_vertices


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
    merged = np.arange(len(places))
    _collapse(places, ends[order[length[order] <= tolerance]], tolerance, merged, np.zeros(len(places)))
    faces = merged[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = faces[np.sort(distinct(np.sort(faces, axis=1))[0])]
    if not len(faces):
        return mesh
    vertices, numbers = np.unique(faces, return_inverse=True)
    used = torch.from_numpy(vertices)
    return Mesh(mesh.vertices[used], torch.from_numpy(numbers.reshape(-1, 3)), mesh.brightness[used])


@compiled
def _collapse(
    places: NDArray[np.float64],
    ends: NDArray[np.int64],
    tolerance: float,
    merged: NDArray[np.int64],
    radius: NDArray[np.float64],
) -> None:
    """Merges the two vertices of each edge, one edge after the other, with a union-find forest.

    Args:
        places: (V, 3).
        ends: (E, 2), edges in the order to collapse them.
        tolerance: how far a vertex may move.
        merged: (V,), 0…V - 1; gets the vertex that each is merged with.
        radius: (V,), 0; gets how far the vertices merged with each one have moved, at most.
    """
    for edge in range(len(ends)):
        a, b = ends[edge, 0], ends[edge, 1]
        while merged[a] != a:
            a = merged[a]
        while merged[b] != b:
            b = merged[b]
        if radius[b] > radius[a]:
            a, b = b, a
        x, y, z = places[a, 0] - places[b, 0], places[a, 1] - places[b, 1], places[a, 2] - places[b, 2]
        moved = math.sqrt(x * x + y * y + z * z) + radius[b]
        if a != b and moved <= tolerance:
            merged[b] = a
            radius[a] = max(radius[a], moved)
    for vertex in range(len(merged)):
        root = vertex
        while merged[root] != root:
            root = merged[root]
        merged[vertex] = root
