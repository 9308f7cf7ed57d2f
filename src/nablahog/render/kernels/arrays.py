"""The arrays that the compiled loops pass to each other.

B poses, H x W pixels or samples, V vertices, F faces, E edges, N crossings of edges.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.floating]
"""float32; the rasteriser also takes float64."""
Integers: TypeAlias = NDArray[np.int32]
Indices: TypeAlias = NDArray[np.int64]
Bytes: TypeAlias = NDArray[np.uint8]
Flags: TypeAlias = NDArray[np.bool_]

AT, SLOPE, DEPTH, MEASURED = 0, 1, 2, 3
"""Columns of :attr:`Crossings.values`."""


class MeshArrays(NamedTuple):
    """A mesh: vertices (V, 3), faces (F, 3), and the brightness (F, 3) at the corners of each face."""

    vertices: Floats
    faces: Integers
    brightness: Floats


class EdgeArrays(NamedTuple):
    """Edges of a mesh.

    Attributes:
        ends, kind: (E, 2) and (E,), as in :class:`..topology.Edges`.
        planes: (2, 4, E): of the planes of both faces, the normal n and the number d with n·x = d; 0 for faces of no
            area.
    """

    ends: Integers
    kind: Integers
    planes: Floats


class PoseArrays(NamedTuple):
    """Poses as the projection takes them.

    Attributes:
        rotation: (B, 3, 3), from the object's frame to the camera's.
        distance: (B,), from the camera to the object's origin.
        eye: (B, 3), the camera in the object's frame.
        centre: (B, 2), x and y of the principal point in samples.
        near: (B,), depth of the near plane; a mesh with a vertex at this depth or before it has to be clipped first.
        nearest: (B,), depth below which vertices are not drawn, nor the faces that have them for corners.
    """

    rotation: Floats
    distance: Floats
    eye: Floats
    centre: Floats
    near: Floats
    nearest: Floats


class Images(NamedTuple):
    """What a rendering writes.

    Attributes:
        image: (B, H, W); holds the background at first.
        screen_gradient: (B, 4, H, W), or (B, 0, H, W) if it is not wanted: see :class:`.compiled.Rendering`.
        clipped: (B,): True where the mesh has to be clipped first, and nothing was drawn.
    """

    image: Floats
    screen_gradient: Floats
    clipped: Flags


class Pixels(NamedTuple):
    """The pixels of one image, and the box in it that samples are taken of.

    Attributes:
        image: (H, W); holds the background at first.
        screen_gradient: (4, H, W), or (0, H, W) if it is not wanted: see :class:`.compiled.Rendering`.
        corner: (2,), row and column of the box's first pixel.
        step: samples of a pixel along a side.
    """

    image: Floats
    screen_gradient: Floats
    corner: Indices
    step: int


class Samples(NamedTuple):
    """Samples of a box of the image.

    Attributes:
        ids: (H, W), the triangle, -1 for the background.
        inverse: (H, W), 1 / depth, 0 for the background.
        brightness: (H, W).
    """

    ids: Integers
    inverse: Floats
    brightness: Floats


class Crossings(NamedTuple):
    """Links between neighbouring samples that a visible edge crosses.

    Attributes:
        number: (2, H, W): 0, or 1 + the index n of the crossing of the link from sample (i, j) down [0] or right [1].
        link: (N, 3): axis, row and column of the link.
        values: (N, 4): where the edge crosses the link, 0…1 (:data:`AT`); samples along the link that the edge advances
            for each sample across it (:data:`SLOPE`); 1 / depth of the edge (:data:`DEPTH`); 1 if the link is along the
            edge's minor axis, on which it is measured, else 0 (:data:`MEASURED`).
        edge: (N,).
    """

    number: Integers
    link: Integers
    values: Floats
    edge: Integers
