"""Images of one rigid object at many poses on a CPU, with what is needed for their derivatives by the pose."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .. import opendr
from ..camera import Camera, rotations
from ..clip import NEAR, clip
from ..edges import Crossings
from ..topology import Edges
from .picture import blend, outlines, shade, visible_edges
from .visibility import frame, project, visibility

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]


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
        self.room = self.faces = 0

    def samples(self, height: int, width: int) -> tuple[Integers, Floats, Floats, Integers]:
        """Arrays for a box of so many samples: ids, inverse, samples and slots, as the kernels call them.

        Afterwards ``edges`` are places, crossings and followed.
        """
        count = height * width
        if count > self.room:
            # Apart by odd parts of a page: at equal places in their pages, they would compete for the same cache lines.
            self.room = (count + count // 2) // 1024 * 1024 + 1024 + 208
            self.block = np.empty((5, self.room), np.int32)
            # of edges: as long as there are links, but what is not used takes no place
            links = 2 * self.room
            self.edges = np.empty((links, 3), np.int32), np.empty((links, 4), np.float32), np.empty(links, np.int32)
        ids, inverse, samples = (part[:count].reshape(height, width) for part in self.block[2:])
        slots = self.block[:2].reshape(-1)[: 2 * count].reshape(2, height, width)
        return ids, inverse.view(np.float32), samples.view(np.float32), slots

    def planes(self, faces: int) -> Floats:
        """For :func:`.picture.shade`."""
        if faces > self.faces:
            self.faces = faces
            self.block_of_faces = np.empty((faces, 7), np.float32)
        return self.block_of_faces


_scratch = _Scratch()


@lru_cache
def _workers(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "nablahog-render")


if hasattr(os, "register_at_fork"):  # a forked process has the pool, but not its threads
    os.register_at_fork(after_in_child=_workers.cache_clear)


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
        image = background.detach().to(torch.float32).expand(batch, -1, -1).contiguous().clone()
        moved = torch.zeros((batch, 4 if derivative else 0, camera.height, camera.width))
        turns = rotations(poses.detach()).to(torch.float32).numpy()
        distances = poses.detach()[:, 2].to(torch.float32).numpy()
        middles = (poses.detach().numpy()[:, 4:] + (camera.width / 2, camera.height / 2)) * self.step
        each = turns, distances, middles.astype(np.float32), image.numpy(), moved.numpy()
        threads = min(torch.get_num_threads(), batch)

        def share(first: int) -> None:
            for k in range(first, batch, threads):
                self._draw(*(part[k] for part in each))

        if threads == 1:
            share(0)
        else:
            list(_workers(threads).map(share, range(threads)))
        return Picture(image, moved)

    def _draw(self, turn: Floats, distance: np.float32, middle: Floats, image: Floats, moved: Floats) -> None:
        step, camera = self.step, self.camera
        screen = np.empty((len(self.vertices), 3), np.float32)
        focal = np.float32(camera.focal * step)
        least = project(self.vertices, turn, distance, focal, middle, screen)
        faces, corners = self.faces, self.corners
        near = NEAR * float(distance)
        if least <= near:
            points = torch.from_numpy(self.vertices @ turn.T + np.array([0, 0, distance], np.float32))
            cut = clip(points, torch.from_numpy(faces).long(), torch.from_numpy(corners), near)
            faces, corners = cut.faces.to(torch.int32).numpy(), cut.corners.contiguous().numpy()
            screen = np.empty((len(cut.points), 3), np.float32)
            project(cut.points.numpy(), np.eye(3, dtype=np.float32), np.float32(0), focal, middle, screen)
            screen[cut.points.numpy()[:, 2] < near * (1 - 1e-6)] = 0
        box = np.empty(4, np.int64)
        frame(screen, step, camera.height, camera.width, box)
        if box[0] >= box[1] or box[2] >= box[3] or not len(faces):
            return
        corner, size = box[::2].copy(), (box[1::2] - box[::2]) * step
        ids, inverse, samples, slots = _scratch.samples(*size.tolist())
        places, crossings, followed = _scratch.edges
        visibility(screen, faces, np.array([0, size[0], 0, size[1]]), ids, inverse)
        shade(screen, faces, corners, ids, inverse, image, corner, step, _scratch.planes(len(faces)), samples)
        outline = np.empty(len(self.kind), np.uint8)
        outlines(self.planes, self.kind, -distance * turn[2], outline)
        count = visible_edges(screen, self.ends, self.kind, outline, inverse, slots, places, crossings, followed)
        if self.method == "edges":
            blend(samples, ids, inverse, slots, places, crossings, count, corner, step, image, moved)
        else:
            rows, cols = slice(box[0], box[1]), slice(box[2], box[3])
            found = places[:count], crossings[:count], followed[:count]
            _opendr(*found, outline, inverse, samples, step, image[rows, cols], moved[:, rows, cols])


def _opendr(
    places: Integers, crossings: Floats, followed: Integers, outline: NDArray[np.uint8],
    inverse: Floats, samples: Floats, step: int, image: Floats, moved: Floats,
) -> None:  # fmt: skip
    """:mod:`..opendr` instead of :func:`.picture.blend`; ``image`` and ``moved`` are those of the box."""
    axis, row, col = torch.from_numpy(places).long().T
    values, edge = torch.from_numpy(crossings), torch.from_numpy(followed).long()
    found = Crossings(
        torch.zeros_like(axis), axis, row, col, values[:, 0], values[:, 1], values[:, 3] > 0, edge, values[:, 0]
    )
    pictures = (torch.from_numpy(part)[None] for part in (inverse, samples))
    on_outline, (depths, drawn) = opendr.overdraw(found, torch.from_numpy(outline)[None] > 0, *pictures)
    image[:] = avg_pool2d(drawn, step)[0].numpy()
    if len(moved):
        along = opendr.differences(drawn, on_outline)
        covered = [-step * torch.where(depths > 0, part, 0) for part in along]
        parts = [covered[0], covered[0] * depths, covered[1], covered[1] * depths]
        moved[:] = avg_pool2d(torch.cat(parts), step).numpy()


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
