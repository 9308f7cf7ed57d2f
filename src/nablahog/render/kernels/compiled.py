"""Images of one rigid object at many poses on a CPU, with what their derivatives by the pose need."""

from __future__ import annotations

import threading
from copy import copy
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...runtime.compile import compiled
from ...runtime.threads import in_threads
from ..camera import Camera
from ..mesh import Mesh
from ..pipeline import NEAR, clip
from ..topology import Edges
from .antialias import antialias
from .arrays import Crossings, EdgeArrays, Floats, Images, MeshArrays, Pixels, PoseArrays, Samples
from .opendr import draw_silhouettes, resolve
from .pose import rotations
from .rasterize import bounding_box, project, rasterize
from .shade import shade
from .silhouettes import edge_crossings, silhouette_edges

_BEFORE_NEAR = 1e-6  # as a share of the near plane's depth: rounding puts clipped vertices no farther before it


class Rendering(NamedTuple):
    """Images, and their derivative by the motion of surfaces on the screen.

    Attributes:
        image: (B, H, W), float32.
        screen_gradient: (B, 4, H, W), float32, or (B, 0, H, W) if it was not asked for.  When surfaces at
            1 / depth = w move by a + b w pixels, the image changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """

    image: Tensor
    screen_gradient: Tensor


class _Scratch(threading.local):
    """Memory that each thread keeps, since new memory is slow at first."""

    def __init__(self) -> None:
        self.size = 0

    def arrays(self, samples: int) -> tuple[Samples, Crossings]:
        """Flat arrays for an image of so many samples, as :func:`render_poses` takes them."""
        if samples > self.size:
            # Offsets by odd parts of a page: arrays at the same place in their pages compete for the same cache lines.
            self.size = (samples + samples // 2) // 1024 * 1024 + 1024 + 208
            number, block = np.empty(2 * self.size, np.int32), np.empty((3, self.size), np.int32)
            self.samples = Samples(block[0], block[1].view(np.float32), block[2].view(np.float32))
            # one crossing a link at most; pages that are never written take no memory
            links = 2 * self.size
            link, values = np.empty((links, 3), np.int32), np.empty((links, 4), np.float32)
            self.crossings = Crossings(number, link, values, np.empty(links, np.int32))
        return self.samples, self.crossings


_scratch = _Scratch()


class CompiledRenderer:
    """An object prepared for many renderings.

    Args:
        mesh: its vertices and faces.
        brightness: (F, 3), at the corners of each face.
        edges: as :func:`..topology.mesh_edges` returns them; all tensors are on the CPU.
        camera: of all images.
        step: samples of a pixel along a side.
        method: "edges" or "opendr".
    """

    def __init__(self, mesh: Mesh, brightness: Tensor, edges: Edges, camera: Camera, step: int, method: str) -> None:
        self.mesh = MeshArrays(
            mesh.vertices.detach().to(torch.float32).contiguous().numpy(),
            mesh.faces.to(torch.int32).contiguous().numpy(),
            brightness.detach().to(torch.float32).contiguous().numpy(),
        )
        ends, _, kind = (part.to(torch.int32).contiguous().numpy() for part in edges)
        self.edges = EdgeArrays(ends, kind, _face_planes(mesh.vertices.detach().numpy(), edges))
        self.camera, self.step, self.method = camera, step, method

    def with_camera(self, camera: Camera) -> CompiledRenderer:
        """The same before another camera; the arrays are shared."""
        other = copy(self)
        other.camera = camera
        return other

    def render(self, poses: Tensor, background: Tensor, derivative: bool) -> Rendering:
        """Images at poses (B, 6), float64, over backgrounds (1 or B, H, W).

        It uses as many threads as PyTorch does; the result does not depend on their number.

        Args:
            poses: see :data:`..camera.PARAMETERS`.
            background: brightness in 0…1.
            derivative: whether to compute the screen gradient.
        """
        camera, batch = self.camera, len(poses)
        shape = batch, camera.height, camera.width
        target = Images(
            np.broadcast_to(background.detach().to(torch.float32).numpy(), shape).copy(),
            np.zeros((batch, 4 if derivative else 0, *shape[1:]), np.float32),
            np.zeros(batch, np.bool_),
        )
        views = self._pose_arrays(poses.detach().numpy())
        threads = min(torch.get_num_threads(), batch)
        in_threads(lambda first: self._render(self.mesh, views, first, threads, target), threads)
        for b in target.clipped.nonzero()[0]:
            one = slice(b, b + 1)
            part = Images(target.image[one], target.screen_gradient[one], np.zeros(1, np.bool_))
            self._render_clipped(PoseArrays(*(each[one] for each in views)), part)
        return Rendering(torch.from_numpy(target.image), torch.from_numpy(target.screen_gradient))

    def _pose_arrays(self, poses: NDArray[np.float64]) -> PoseArrays:
        rotation, distance = rotations(poses), poses[:, 2]
        eye = -distance[:, None] * rotation[:, 2]
        centre = (poses[:, 4:] + (self.camera.width / 2, self.camera.height / 2)) * self.step
        near = NEAR * distance
        parts = rotation, distance, eye, centre, near, near * (1 - _BEFORE_NEAR)
        return PoseArrays(*(part.astype(np.float32) for part in parts))

    def _render(self, mesh: MeshArrays, views: PoseArrays, first: int, stride: int, target: Images) -> None:
        camera, step = self.camera, self.step
        scratch = _scratch.arrays(camera.height * camera.width * step**2)
        focal, antialiased = np.float32(camera.focal * step), self.method == "edges"
        render_poses(mesh, self.edges, views, focal, step, antialiased, first, stride, target, *scratch)

    def _render_clipped(self, view: PoseArrays, target: Images) -> None:
        """Renders one pose with a part of the object behind the near plane."""
        points = torch.from_numpy(self.mesh.vertices @ view.rotation[0].T)
        points[:, 2] += float(view.distance[0])
        faces, brightness = torch.from_numpy(self.mesh.faces).long(), torch.from_numpy(self.mesh.brightness)
        part = clip(points, faces, brightness, float(view.near[0]))
        mesh = MeshArrays(part.points.numpy(), part.faces.to(torch.int32).numpy(), part.brightness.contiguous().numpy())
        in_camera_frame = view._replace(
            rotation=np.eye(3, dtype=np.float32)[None],
            distance=np.zeros_like(view.distance),
            near=view.near - np.inf,
        )
        self._render(mesh, in_camera_frame, 0, 1, target)


def _face_planes(vertices: NDArray[np.float64], edges: Edges) -> Floats:
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


@compiled
def render_poses(
    mesh: MeshArrays,
    edges: EdgeArrays,
    poses: PoseArrays,
    focal: float,
    step: int,
    antialiased: bool,
    first: int,
    stride: int,
    target: Images,
    scratch: Samples,
    crossed: Crossings,
) -> None:
    """Renders a mesh over ``target.image`` at the poses ``first``, ``first + stride``, ….

    Args:
        mesh, edges, poses: of the object and its views.
        focal: focal length in samples.
        step: samples of a pixel along a side.
        antialiased: by :func:`.antialias.antialias`, else as OpenDR does.
        first, stride: so that several threads share the poses out.
        target: gets the images.
        scratch, crossed: memory, flat, for all samples of an image, and for as many crossings as there is room.
    """
    vertices, faces, kind = mesh.vertices, mesh.faces, edges.kind
    eyes = poses.eye[first::stride]
    screen = np.empty((vertices.shape[0], 3), vertices.dtype)
    gradients = np.empty((faces.shape[0], 7), vertices.dtype)
    silhouettes, candidates = np.empty((len(eyes), kind.size), np.uint8), np.empty(kind.size, np.int32)
    silhouette_edges(edges, eyes, silhouettes)
    box, all_samples, corner = np.empty(4, np.int64), np.zeros(4, np.int64), np.empty(2, np.int64)
    if faces.shape[0] == 0:
        return
    for b in range(first, target.image.shape[0], stride):
        depth = project(
            vertices, poses.rotation[b], poses.distance[b], focal, poses.centre[b], poses.nearest[b], screen
        )
        if depth <= poses.near[b]:
            target.clipped[b] = True
            continue
        bounding_box(screen, step, target.image.shape[1], target.image.shape[2], box)
        if box[0] >= box[1] or box[2] >= box[3]:
            continue
        corner[0], corner[1] = box[0], box[2]
        height, width = (box[1] - box[0]) * step, (box[3] - box[2]) * step
        all_samples[1], all_samples[3] = height, width
        size = height * width
        samples = Samples(
            scratch.ids[:size].reshape(height, width),
            scratch.inverse[:size].reshape(height, width),
            scratch.brightness[:size].reshape(height, width),
        )
        number = crossed.number[: 2 * size].reshape(2, height, width)
        crossings = Crossings(number, crossed.link, crossed.values, crossed.edge)
        pixels, silhouette = Pixels(target.image[b], target.screen_gradient[b], corner, step), silhouettes[b // stride]
        rasterize(screen, faces, all_samples, samples.ids, samples.inverse)
        shade(screen, mesh, pixels, gradients, samples)
        count = edge_crossings(screen, edges, silhouette, candidates, samples.inverse, crossings)
        if antialiased:
            antialias(samples, crossings, count, pixels)
        else:
            draw_silhouettes(samples, silhouette, crossings, count)
            resolve(samples, number[0], pixels)
