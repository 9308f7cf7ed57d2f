"""Images of a mesh at poses, differentiable in everything that makes them (Section 3.2, f(V, A, C))."""

from __future__ import annotations

from copy import copy
from ctypes import c_bool, c_double, c_int64, c_void_p
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import torch
from torch import Tensor

from .. import native
from ..inputs.arrays import as_images
from ..inputs.numbers import as_integer, as_number, check_choice, check_type
from ..inputs.tensors import check_device, check_shape, check_values
from ..runtime.pytorch import run_in_threads
from .camera import Camera, check_camera, check_poses
from .differentiated_once import DifferentiatedOnce
from .mesh import Mesh, check_mesh
from .pipeline import render_torch
from .pose_rendering import PoseRendering
from .surface import Edges, Light, corner_brightness, face_planes, mesh_edges, smoothing_groups

_FLOATS, _INTEGERS = native.array(np.float32), native.array(np.int32)
_SHADED_MESH = _FLOATS, c_int64, _INTEGERS, _FLOATS, c_int64, _INTEGERS, _INTEGERS, _FLOATS, c_int64
_CAMERA = c_double, c_int64, c_int64, c_int64, c_bool
_render = native.function(
    "render", *_SHADED_MESH, *_CAMERA, native.array(np.float64), c_int64, c_int64, _FLOATS, c_void_p
)

EdgeMethod: TypeAlias = Literal["edges", "opendr"]
SUPERSAMPLING = 4
DEFAULT_LIGHT = Light()
_ROUNDING = 1e-5  # by which a background may leave 0…1


class Rendering(NamedTuple):
    """Images, and their derivative by the motion of surfaces on the screen.

    Attributes:
        image: (B, H, W), float32; where several edges meet in a pixel, it may leave 0…1.
        screen_gradient: (B, 4, H, W), float32, or (B, 0, H, W) if it was not asked for.  When surfaces at
            1 / depth = w move by a + b w pixels, the image changes by a_x [0] + b_x [1] + a_y [2] + b_y [3].
    """

    image: Tensor
    screen_gradient: Tensor


class Renderer:
    """A mesh with a light and a camera, prepared for many renderings.

    The topology of the mesh, its edges and smoothing groups, is computed once, here, and is not differentiable.

    Args:
        mesh: on the device where to render.
        camera: the camera of all images.
        light: the light of the scene.
        method: how edges are drawn and differentiated.  ``"edges"``: anti-aliased, with the exact derivative of the
            covered area, :mod:`.edge_gradient`; ``"opendr"``: as the paper's renderer, :mod:`.pipeline`.
        supersampling: samples along a side of a pixel, 1 to 16.  The default is the smallest with accurate derivatives
            (``benchmarks/rendering.py``); 1 and 2 are several times faster, for searches.

    Attributes:
        mesh, camera, light, method, supersampling: the arguments.
        edges: those of the mesh.

    Raises:
        TypeError, ValueError: ``mesh``, ``method`` or ``supersampling`` is none of the above.

    >>> from nablahog.render import Camera, Mesh, Renderer, pose
    >>> corners = [[-0.5, 0, -0.5], [0.5, 0, -0.5], [0, 0, 0.5]]  # a triangle that faces the camera
    >>> mesh = Mesh(corners, faces=[[0, 1, 2]], brightness=[0.2, 0.2, 0.2])
    >>> renderer = Renderer(mesh, Camera.from_field_of_view(30, height=64, width=48))
    >>> poses = pose(azimuth=0, distance=3).requires_grad_()
    >>> image = renderer(poses)
    >>> image.shape
    torch.Size([1, 1, 64, 48])
    >>> image.sum().backward()  # from farther away more of the white background is visible
    >>> bool(poses.grad[0, 2] > 0)
    True
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        light: Light = DEFAULT_LIGHT,
        method: EdgeMethod = "edges",
        supersampling: int = SUPERSAMPLING,
    ) -> None:
        check_choice("method", method, EdgeMethod)
        self.mesh, self.camera, self.light = check_mesh(mesh), check_camera(camera), check_type("light", light, Light)
        self.method, self.supersampling = method, as_integer("supersampling", supersampling, 1, 16)
        self.edges: Edges = mesh_edges(mesh)
        self._groups = smoothing_groups(mesh)
        self._brightness = corner_brightness(mesh, self._groups, light).detach()

    def with_camera(self, camera: Camera) -> Renderer:
        """The same mesh before another camera; what was prepared of the mesh is shared."""
        if native.available() and self.mesh.vertices.device.type == "cpu":
            self._native_arguments  # noqa: B018  # computed before they are shared, once for all cameras
        other = copy(self)
        other.camera = check_camera(camera)
        return other

    def __call__(self, poses: Tensor, background: float | Tensor = 1.0) -> Tensor:
        """Images of the mesh.

        Differentiable in ``poses``, the mesh's vertices and brightness, and ``background``, in reverse and forward
        mode, and by the transforms of ``torch.func``: once, but by the brightness and the background again.

        Where only poses are differentiated, this is :meth:`render` in float32;
        otherwise PyTorch, :func:`.pipeline.render_torch`.  Images agree up to rounding, derivatives by poses up to one
        or two percent with ``"edges"``: the former moves a whole pixel as the surface in its middle.

        Args:
            poses: (B, 6), B at least 1, floating point, see :data:`.camera.PARAMETERS`; computed with in float64.
            background: a brightness in 0…1, or images of it, (1 or B, 1, H, W), float32 or float64.

        Returns:
            (B, 1, H, W) in 0…1, float32; float64 if the background is an image in float64.

        Raises:
            ValueError: ``poses`` is no finite (B, 6) tensor with distances above 0, or ``background`` is not as above.
            NotImplementedError: from a second derivative by poses or vertices, or by these and another input.
        """
        check_poses(poses)
        check_device("poses", poses, "mesh.vertices", self.mesh.vertices)
        behind, mesh = self._background(background, poses), self.mesh
        # an optimiser may have changed the mesh since the last call: compute its brightness anew
        by_mesh = any(part.requires_grad or is_differentiated(part) for part in (mesh.vertices, mesh.brightness))
        in_torch = behind.dtype == torch.float64 or mesh.vertices.device.type != "cpu"
        if by_mesh or in_torch or (isinstance(background, Tensor) and is_differentiated(background)):
            brightness = corner_brightness(mesh, self._groups, self.light) if by_mesh else self._brightness
            view = poses.double(), self.camera, behind
            image = render_torch(mesh, brightness, self.edges, *view, self.supersampling, self.method)
            image = image - (image - image.clamp(0, 1)).detach()  # the derivative stays
        else:
            inputs = poses.double(), behind, self.render, self.camera, is_differentiated(poses)
            image = PoseRendering.apply(*inputs)[0][:, None]  # type: ignore[no-untyped-call]
        return DifferentiatedOnce.apply(image, poses, mesh.vertices, mesh.brightness, behind)  # type: ignore[no-any-return, no-untyped-call]

    def render(self, poses: Tensor, background: float | Tensor = 1.0, *, derivative: bool) -> Rendering:
        """Images, and on request the screen gradient, which :func:`.pose_vjp` and :func:`.pose_jacobian` take.

        For searches: nothing is recorded for autograd.  The result does not depend on the number of threads.

        Args:
            poses: (B, 6), see :data:`.camera.PARAMETERS`; computed with in float64; their numbers are not checked.
            background: a brightness in 0…1, or images of it, (1 or B, H, W).
            derivative: whether to compute the screen gradient.

        Raises:
            TypeError, ValueError: ``poses`` is no floating point tensor (B, 6), or has no values.
        """
        check_values("poses", check_shape("poses", poses, ("B", 6)))
        poses = poses.double()  # the loops read six numbers of each
        camera, shape = self.camera, (len(poses), self.camera.height, self.camera.width)
        behind = torch.as_tensor(background, dtype=torch.float32, device=poses.device).detach().expand(shape)
        if not native.can_read(poses):
            how = self.supersampling, self.method, derivative
            with torch.no_grad():
                images = render_torch(self.mesh, self._brightness, self.edges, poses, camera, behind, *how)
            return Rendering(images[:, 0].clone(), images[:, 1:].clone())
        # copied by NumPy: PyTorch would wake its own threads, which keep processors busy while they wait
        image = behind.numpy().astype(np.float32, order="C")
        screen_gradient = np.zeros((len(poses), 4 * derivative, *shape[1:]), np.float32)
        pointer = screen_gradient.ctypes.data if derivative else None
        view = camera.focal, *shape[1:], self.supersampling, self.method == "edges", poses.detach().contiguous()
        run_in_threads(_render, len(poses), (*self._native_arguments, *view), (image, pointer))
        return Rendering(torch.from_numpy(image), torch.from_numpy(screen_gradient))

    @cached_property
    def _native_arguments(self) -> tuple[Any, ...]:
        vertices = self.mesh.vertices.detach().float().contiguous()
        faces, brightness = self.mesh.faces.int().contiguous(), self._brightness.float().contiguous()
        ends, kind = self.edges.ends.int().contiguous(), self.edges.kind.int().contiguous()
        planes = face_planes(self.mesh.vertices.detach().double().numpy(), self.edges)
        return vertices, len(vertices), faces, brightness, len(faces), ends, kind, planes, len(ends)

    def _background(self, background: float | Tensor, poses: Tensor) -> Tensor:
        height, width = self.camera.height, self.camera.width
        if not getattr(background, "ndim", 0):
            level = as_number("the background", background, 0, 1)
            if isinstance(background, Tensor):  # perhaps differentiated
                return background.to(poses.device, torch.float32).expand(1, height, width)
            return torch.full((1, height, width), level, dtype=torch.float32, device=poses.device)
        background, _ = as_images("the background", background)
        check_values("the background", background)
        check_device("the background", background, "poses", poses)
        if background.shape not in ((1, 1, height, width), (len(poses), 1, height, width)):
            raise ValueError(
                f"the background must be a number or have shape (1 or {len(poses)}, 1, {height}, {width}), "
                f"got {tuple(background.shape)}"
            )
        if background.dtype not in (torch.float32, torch.float64):
            raise ValueError(f"the background must be float32 or float64, got {background.dtype}")
        background = background.resolve_neg()
        low, high = background.detach().aminmax()
        if not (low >= -_ROUNDING and high <= 1 + _ROUNDING):  # NaN fails too
            raise ValueError(f"the background must lie in 0…1, got {float(low)}…{float(high)}")
        return background[:, 0]


def is_differentiated(tensor: Tensor) -> bool:
    """Whether a derivative by it is wanted, in reverse or forward mode."""
    dual = torch.autograd.forward_ad.unpack_dual(tensor)  # type: ignore[no-untyped-call]
    return (tensor.requires_grad and torch.is_grad_enabled()) or dual.tangent is not None


def render(
    mesh: Mesh,
    poses: Tensor,
    camera: Camera,
    *,
    background: float | Tensor = 1.0,
    light: Light = DEFAULT_LIGHT,
    method: EdgeMethod = "edges",
    supersampling: int = SUPERSAMPLING,
) -> Tensor:
    """Renders a mesh at poses.  For many calls use :class:`Renderer`, which prepares the mesh once.

    Args:
        mesh: on the device where to render.
        poses: (B, 6), B at least 1, floating point: azimuth, elevation, distance, theta, x, y, in degrees, units of the
            mesh and pixels, see :data:`.camera.PARAMETERS`.
        camera: gives the images' height H and width W.
        background: a brightness in 0…1, or images of it, (1 or B, 1, H, W), float32 or float64.
        light, method, supersampling: as for :class:`Renderer`.

    Returns:
        (B, 1, H, W) in 0…1, float32; float64 if the background is an image in float64.  Differentiable in ``poses``,
        the mesh's vertices and brightness, and ``background``, see :meth:`Renderer.__call__`.

    Raises:
        ValueError: an argument is not as above.

    Source: Section 3.2, f(V, A, C).

    >>> from nablahog.render import Camera, Mesh, pose, render
    >>> square = [[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]]
    >>> mesh = Mesh(square, faces=[[0, 1, 2], [0, 2, 3]], brightness=[0.0, 0.0, 0.0, 0.0])
    >>> views = torch.cat([pose(azimuth=0, distance=4), pose(azimuth=60, distance=4)])
    >>> images = render(mesh, views, Camera(focal=64, height=32, width=32))
    >>> images.shape, images.dtype
    (torch.Size([2, 1, 32, 32]), torch.float32)
    >>> dark = (1 - images).sum((1, 2, 3))  # pixels covered: 16² from the front, about half as many at 60 degrees
    >>> [round(float(number)) for number in dark]
    [256, 131]
    """
    return Renderer(mesh, camera, light=light, method=method, supersampling=supersampling)(poses, background)


def silhouette(mesh: Mesh, poses: Tensor, camera: Camera, *, supersampling: int = SUPERSAMPLING) -> Tensor:
    """Coverage of each pixel by the object.

    Args:
        mesh, poses, camera, supersampling: as for :func:`.renderer.render`.

    Returns:
        (B, 1, H, W) in 0…1, float32; differentiable as an image of :func:`.renderer.render`.

    Raises:
        ValueError: as :func:`.renderer.render`.

    >>> from nablahog.render import pose, silhouette
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 64, 64)
    >>> coverage = silhouette(mesh, pose(azimuth=30, distance=3), camera)
    >>> coverage.shape, float(coverage.max())
    (torch.Size([1, 1, 64, 64]), 1.0)
    """
    white = Mesh(check_mesh(mesh).vertices, mesh.faces, torch.ones_like(mesh.brightness))
    everywhere = Light(ambient=1.0, diffuse=0.0)
    return render(white, poses, camera, background=0.0, light=everywhere, supersampling=supersampling)
