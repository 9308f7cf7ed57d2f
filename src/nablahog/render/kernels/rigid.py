"""Images of one rigid object at many poses on a CPU, with what is needed for their derivatives by the pose."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .. import opendr
from ..camera import Camera, rotations
from ..clip import NEAR, clip
from ..edges import Crossings, outlines
from ..topology import Edges
from .picture import blend, forget, shade, visible_edges
from .visibility import extent, project, visibility

Floats = NDArray[np.float32]


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
    """Arrays of the size of the samples, for each thread and size once."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None

    def fit(self, height: int, width: int) -> None:
        if self.size != (height, width):
            self.size = (height, width)
            self.ids = np.empty(self.size, np.int32)
            self.inverse, self.samples = np.empty(self.size, np.float32), np.empty(self.size, np.float32)
            self.slots = np.full((2, height, width), -1, np.int32)
            self.places = np.empty((2 * height * width, 3), np.int32)
            self.crossings = np.empty((2 * height * width, 4), np.float32)
            self.followed = np.empty(2 * height * width, np.int32)


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
        self.topology = edges
        self.edges = [part.to(torch.int32).contiguous().numpy() for part in edges]
        self.camera, self.step, self.method = camera, step, method

    def draw(self, poses: Tensor, background: Tensor, derivative: bool) -> Picture:
        """Poses (B, 6) float64 before backgrounds (1 or B, H, W); ``derivative`` says whether ``motion`` is needed."""
        camera, batch = self.camera, len(poses)
        image = background.detach().to(torch.float32).expand(batch, -1, -1).contiguous().clone()
        moved = torch.zeros((batch, 4 if derivative else 0, camera.height, camera.width))
        turns, rows = rotations(poses.detach()).to(torch.float32).numpy(), poses.detach().numpy()
        for k in range(batch):
            self._draw(turns[k], rows[k], image[k], moved[k])
        return Picture(image, moved)

    def _draw(self, turn: Floats, pose: NDArray[np.float64], image: Tensor, moved: Tensor) -> None:
        step, camera = self.step, self.camera
        height, width = camera.height * step, camera.width * step
        scratch = _scratch
        scratch.fit(height, width)
        screen = np.empty((len(self.vertices), 3), np.float32)
        middle = np.array([camera.width / 2 + pose[4], camera.height / 2 + pose[5]], np.float32) * np.float32(step)
        distance, focal = np.float32(pose[2]), np.float32(camera.focal * step)
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
        extent(screen[screen[:, 2] > 0] if least <= near else screen, step, height, width, box)
        if box[0] >= box[1] or box[2] >= box[3] or not len(faces):
            return
        seen = scratch.ids, scratch.inverse
        visibility(screen, faces, box, *seen)
        shade(
            screen,
            faces,
            corners,
            box,
            *seen,
            image.numpy(),
            step,
            np.zeros((len(faces), 6), np.float32),
            scratch.samples,
        )
        count = visible_edges(
            screen, *self.edges, box, *seen, scratch.slots, scratch.places, scratch.crossings, scratch.followed
        )
        if self.method == "edges":
            blend(scratch.samples, *seen, box, scratch.slots, scratch.crossings, step, image.numpy(), moved.numpy())
        else:
            self._opendr(box, count, screen, image, moved)
        forget(scratch.slots, scratch.places, count)

    def _opendr(self, box: NDArray[np.int64], count: int, screen: Floats, image: Tensor, moved: Tensor) -> None:
        scratch, step = _scratch, self.step
        top, bottom, left, right = (int(side) for side in box)
        inside = slice(top, bottom), slice(left, right)
        axis, row, col = torch.from_numpy(scratch.places[:count]).long().T
        values = torch.from_numpy(scratch.crossings[:count])
        edge = torch.from_numpy(scratch.followed[:count]).long()
        found = Crossings(
            torch.zeros_like(axis), axis, row - top, col - left, values[:, 0], values[:, 1], values[:, 3] > 0, edge,
            values[:, 0],
        )  # fmt: skip
        inverse, samples = (torch.from_numpy(part[inside].copy())[None] for part in (scratch.inverse, scratch.samples))
        on_outline, (inverse, samples) = opendr.overdraw(
            found, outlines(torch.from_numpy(screen)[None], self.topology), inverse, samples
        )
        pixels = slice(top // step, bottom // step), slice(left // step, right // step)
        image[pixels] = avg_pool2d(samples, step)[0]
        if len(moved):
            along = opendr.differences(samples, on_outline)
            covered = [-step * torch.where(inverse > 0, part, 0) for part in along]
            parts = [covered[0], covered[0] * inverse, covered[1], covered[1] * inverse]
            moved[:, pixels[0], pixels[1]] = avg_pool2d(torch.cat(parts), step)
