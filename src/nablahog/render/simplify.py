"""Meshes with fewer faces, for pictures too small to show more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch

from ..runtime.compile import compiled
from .mesh import Mesh, distinct
from .topology import welded


def simplified(mesh: Mesh, reach: float) -> Mesh:
    """A mesh whose vertices have been merged along edges, the shortest first, as long as none moves by more than
    ``reach``, in units of the mesh.

    Faces that have become lines, or the same as others, are left out; a mesh that would lose all faces stays as it is.
    What is thinner than ``reach`` may become flat, but parts that no edge joins stay apart.
    """
    places = mesh.vertices.numpy()
    faces = welded(places)[mesh.faces.numpy()]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    order = np.argsort(length, kind="stable")
    merged = np.arange(len(places))
    _merge(places, ends[order[length[order] <= reach]], reach, merged, np.zeros(len(places)))
    faces = merged[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = faces[np.sort(distinct(np.sort(faces, axis=1))[0])]
    if not len(faces):
        return mesh
    used, numbers = np.unique(faces, return_inverse=True)
    kept = torch.from_numpy(used)
    return Mesh(mesh.vertices[kept], torch.from_numpy(numbers.reshape(-1, 3)), mesh.brightness[kept])


@compiled
def _merge(places: Any, ends: Any, reach: float, merged: Any, radius: Any) -> None:
    """Merges the vertices at the ``ends`` (E, 2) of edges, one edge after the other.

    Args:
        places: (V, 3).
        merged: (V,), vertices' own numbers; gets the vertex that each is merged with.
        radius: (V,), 0; how far those merged with a vertex have moved, at most.
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
        if a != b and moved <= reach:
            merged[b] = a
            radius[a] = max(radius[a], moved)
    for vertex in range(len(merged)):
        kept = vertex
        while merged[kept] != kept:
            kept = merged[kept]
        merged[vertex] = kept
