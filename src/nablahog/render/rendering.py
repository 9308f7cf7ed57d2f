"""Images of one rigid object at many poses, and their derivative by the motion of its surfaces on the screen."""

from __future__ import annotations

from ctypes import c_bool, c_double, c_int64, c_void_p
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .. import native
from ..runtime.pytorch import share_out
from .camera import Camera
from .mesh import Mesh
from .pipeline import render_torch
from .topology import Edges

_FLOATS, _INTEGERS = native.array(np.float32), native.array(np.int32)
_MESH = _FLOATS, c_int64, _INTEGERS, _FLOATS, c_int64, _INTEGERS, _INTEGERS, _FLOATS, c_int64
_CAMERA = c_double, c_int64, c_int64, c_int64, c_bool
_render = native.function("render", *_MESH, *_CAMERA, native.array(np.float64), c_int64, c_int64, _FLOATS, c_void_p)


class Rendering(NamedTuple):
    """Images, and their derivative by the motion of surfaces on the screen.

    Attributes:
        image: (B, H, W), float32; where several edges meet in a pixel, it may leave 0…1.
        screen_gradient: (B, 4, H, W), float32, or (B, 0, H, W) if it was not asked for.  When surfaces at
            1 / depth = w move by a + b w pixels, the image changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """

    image: Tensor
    screen_gradient: Tensor


class RigidObject:
    """An object prepared for many renderings.

    Args:
        mesh: its vertices and faces.
        brightness: (F, 3), at the corners of each face.
        edges: as :func:`.topology.mesh_edges` returns them.
    """

    def __init__(self, mesh: Mesh, brightness: Tensor, edges: Edges) -> None:
        self.mesh, self.brightness, self.edges = mesh, brightness.detach(), edges

    def render(
        self, poses: Tensor, camera: Camera, background: Tensor, step: int, method: str, derivative: bool
    ) -> Rendering:
        """Renders the object at poses (B, 6), float64, over backgrounds (1 or B, H, W); see :meth:`.Renderer.render`.

        The plain steps of :func:`.pipeline.render_torch` on another device and without native loops.
        """
        if not native.can_read(poses):
            with torch.no_grad():
                images = render_torch(
                    self.mesh, self.brightness, self.edges, poses, camera, background.float(), step, method, derivative
                )
            return Rendering(images[:, 0].clone(), images[:, 1:].clone())
        shape = len(poses), camera.height, camera.width
        # filled by NumPy: PyTorch would wake its own threads, which keep processors busy while they wait
        image = np.broadcast_to(background.detach().numpy(), shape).astype(np.float32, order="C")
        screen_gradient = np.zeros((len(poses), 4 * derivative, *shape[1:]), np.float32)
        numbers, pointer = poses.detach().contiguous(), screen_gradient.ctypes.data if derivative else None
        arguments = *self._native_arguments, camera.focal, *shape[1:], step, method == "edges", numbers

        def work(first: int, last: int) -> None:
            _render(*arguments, first, last, image, pointer)

        share_out(work, len(poses))
        return Rendering(torch.from_numpy(image), torch.from_numpy(screen_gradient))

    @cached_property
    def _native_arguments(self) -> tuple[Any, ...]:
        vertices = self.mesh.vertices.detach().float().contiguous()
        faces, brightness = self.mesh.faces.int().contiguous(), self.brightness.float().contiguous()
        ends, kind = self.edges.ends.int().contiguous(), self.edges.kind.int().contiguous()
        planes = _face_planes(self.mesh.vertices.detach().double().numpy(), self.edges)
        return vertices, len(vertices), faces, brightness, len(faces), ends, kind, planes, len(ends)


def _face_planes(vertices: NDArray[np.float64], edges: Edges) -> NDArray[np.float32]:
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
