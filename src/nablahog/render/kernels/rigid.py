"""Images of one rigid object at many poses on a CPU, with what is needed for their derivatives by the pose."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...runtime.threads import in_threads
from ..camera import Camera
from ..clip import NEAR, clip
from ..topology import Edges
from .draw import draw
from .turns import turns

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

_TOUCHING = 1e-6  # as a share of the near plane's depth: rounding puts cuts no farther before it


class Picture(NamedTuple):
    """Images and how they change as surfaces move.

    Attributes:
        image: (B, H, W), float32.
        motion: (B, 4, H, W), float32, or (B, 0, H, W): when surfaces at 1 / depth w move by a + b w pixels, the image
            changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """

    image: Tensor
    motion: Tensor


class _Scratch(threading.local):
    """Memory that each thread keeps, since new memory is slow at first."""

    def __init__(self) -> None:
        self.room = 0

    def arrays(self, samples: int) -> tuple[Integers | Floats, ...]:
        """For an image of so many samples: ids, inverse, samples, slots, places, crossings and followed, as
        :func:`.draw.draw` calls them."""
        if samples > self.room:
            # Apart by odd parts of a page: at equal places in their pages, they would compete for the same cache lines.
            self.room = (samples + samples // 2) // 1024 * 1024 + 1024 + 208
            slots, block = np.empty(2 * self.room, np.int32), np.empty((3, self.room), np.int32)
            # of edges: as long as there are links, but what is not used takes no place
            links = 2 * self.room
            edges = np.empty((links, 3), np.int32), np.empty((links, 4), np.float32), np.empty(links, np.int32)
            self.kept = block[0], block[1].view(np.float32), block[2].view(np.float32), slots, *edges
        return self.kept


_scratch = _Scratch()


class Rigid:
    """An object prepared for many renderings.

    Args:
        vertices: (V, 3); faces: (F, 3); corners: (F, 3), their brightness; edges: as :func:`..topology.edges` makes
            them; all on the CPU.
        camera: of all images.
        step: samples of a pixel along a side.
        method: "edges" or "opendr".
    """

    def __init__(
        self, vertices: Tensor, faces: Tensor, corners: Tensor, edges: Edges, camera: Camera, step: int, method: str
    ) -> None:
        self.vertices = vertices.detach().to(torch.float32).contiguous().numpy()
        self.faces = faces.to(torch.int32).contiguous().numpy()
        self.corners = corners.detach().to(torch.float32).contiguous().numpy()
        self.ends, _, self.kind = (part.to(torch.int32).contiguous().numpy() for part in edges)
        self.planes = _planes(vertices.detach().numpy(), edges)
        self.camera, self.step, self.method = camera, step, method

    def draw(self, poses: Tensor, background: Tensor, derivative: bool) -> Picture:
        """Poses (B, 6) float64 before backgrounds (1 or B, H, W); ``derivative`` says whether ``motion`` is needed.

        It takes as many threads as PyTorch does; the result does not depend on them.
        """
        camera, batch = self.camera, len(poses)
        shape = batch, camera.height, camera.width
        image = np.broadcast_to(background.detach().to(torch.float32).numpy(), shape).copy()
        moved = np.zeros((batch, 4 if derivative else 0, *shape[1:]), np.float32)
        given = poses.detach().numpy()
        turned, distances = turns(given), given[:, 2]
        eyes = -distances[:, None] * turned[:, 2]
        middles = (given[:, 4:] + (camera.width / 2, camera.height / 2)) * self.step
        near = NEAR * distances
        nearest = near * (1 - _TOUCHING)
        of_pose = [part.astype(np.float32) for part in (turned, distances, eyes, middles, near, nearest)]
        cut = np.zeros(batch, np.bool_)
        threads = min(torch.get_num_threads(), batch)

        def share(first: int) -> None:
            of_mesh = self.vertices, self.faces, self.corners
            self._draw(of_mesh, of_pose, first, threads, image, moved, cut)

        in_threads(share, threads)
        for b in cut.nonzero()[0]:
            self._draw_cut([part[b : b + 1] for part in of_pose], image[b : b + 1], moved[b : b + 1])
        return Picture(torch.from_numpy(image), torch.from_numpy(moved))

    def _draw(
        self, of_mesh: Sequence[Floats | Integers], of_pose: Sequence[Floats], first: int, every: int, *to: NDArray[Any]
    ) -> None:
        camera, step = self.camera, self.step
        scratch = _scratch.arrays(camera.height * camera.width * step**2)
        draw(
            *of_mesh, self.ends, self.kind, self.planes, *of_pose[:4], np.float32(camera.focal * step), *of_pose[4:],
            step, self.method == "edges", first, every, *to, *scratch,
        )  # fmt: skip

    def _draw_cut(self, of_pose: Sequence[Floats], image: Floats, moved: Floats) -> None:
        """The same for one pose with a part of the object behind the near plane."""
        turned, distances, eyes, middles, near, nearest = of_pose
        points = torch.from_numpy(self.vertices @ turned[0].T)
        points[:, 2] += float(distances[0])
        faces, corners = torch.from_numpy(self.faces).long(), torch.from_numpy(self.corners)
        found = clip(points, faces, corners, float(near[0]))
        of_mesh = found.points.numpy(), found.faces.to(torch.int32).numpy(), found.corners.contiguous().numpy()
        here = np.eye(3, dtype=np.float32)[None], np.zeros_like(distances), eyes, middles, near - np.inf, nearest
        self._draw(of_mesh, here, 0, 1, image, moved, np.zeros(1, np.bool_))


def _planes(vertices: NDArray[np.float64], edges: Edges) -> Floats:
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
