"""render(): a mesh, poses and a camera to images, differentiable in all that makes them (Section 3.2, f(V, A, C))."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal, TypeAlias

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .camera import Camera, check_poses, motion
from .kernels.moments import moments
from .kernels.rigid import Rigid
from .kernels.turns import by_pose
from .mesh import Mesh
from .shading import Light, corner_brightness
from .steps import render_steps
from .topology import Edges, edges, smoothing

Method: TypeAlias = Literal["edges", "opendr"]
SUPERSAMPLING = 4
LIGHT = Light()
_ROUNDING = 1e-5  # so far beyond 0…1 a background may be


class Renderer:
    """A mesh under a light before a camera, prepared for many renderings.

    Args:
        mesh: on the device where to render.
        camera: of all images.
        light: that shines on the mesh.
        method: how the image and its derivative treat outlines.  ``"edges"``: anti-aliased by the area that the mesh's
            own edges cover, with the exact derivative of that area; ``"opendr"``: as the paper's renderer, see
            :mod:`.opendr`.
        supersampling: samples of a pixel along a side, 1 to 16.  The default is the least that was measured right
            (``benchmarks/image_derivative.py``); 1 and 2 are several times faster, for searches.

    Which edges the mesh has and which of its faces are smooth is found once, here, and a constant to any
    differentiation.

    Attributes:
        mesh, camera, light, method, supersampling: as given.
        edges: those of the mesh.

    Raises:
        ValueError: ``method`` or ``supersampling`` is none of the above.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        light: Light = LIGHT,
        method: Method = "edges",
        supersampling: int = SUPERSAMPLING,
    ) -> None:
        if method not in ("edges", "opendr"):
            raise ValueError(f"method must be 'edges' or 'opendr', got {method!r}")
        if not isinstance(supersampling, int) or not 1 <= supersampling <= 16:
            raise ValueError(f"supersampling must be an integer from 1 to 16, got {supersampling!r}")
        self.mesh, self.camera, self.light = mesh, camera, light
        self.method, self.supersampling = method, supersampling
        self.edges: Edges = edges(mesh)
        self._smoothing = smoothing(mesh)
        self._lit = corner_brightness(mesh, self._smoothing, light).detach()

    @cached_property
    def rigid(self) -> Rigid:
        """The compiled renderings of the mesh as it is, on a CPU."""
        mesh = self.mesh
        return Rigid(mesh.vertices, mesh.faces, self._lit, self.edges, self.camera, self.supersampling, self.method)

    def __call__(self, poses: Tensor, background: float | Tensor = 1.0) -> Tensor:
        """Images of the mesh.

        Differentiable in ``poses``, the mesh's vertices and brightness, and ``background``, in reverse and forward
        mode, also by the transforms of ``torch.func``.  Where nothing but poses is differentiated, on a CPU, it takes
        compiled loops, in float32, which can be differentiated once; else plain PyTorch, :func:`.steps.render_steps`.
        The images of both agree up to rounding, the derivatives by poses up to one or two percent with ``"edges"``: the
        compiled loops take a surface's motion in the middle of a pixel for that in the whole pixel.

        Args:
            poses: (B, 6), B at least 1, floating point, see :data:`.camera.PARAMETERS`; computed with in float64.
            background: a brightness in 0…1, or images of it, (1 or B, 1, H, W), float32 or float64.

        Returns:
            (B, 1, H, W) in 0…1, float32; float64 where the background is an image in float64.

        Raises:
            ValueError: ``poses`` is no finite (B, 6) tensor with distances above 0, or ``background`` is not as above.
        """
        check_poses(poses)
        behind, mesh = self._background(background, poses), self.mesh
        # a mesh to be differentiated by is looked at anew each time: an optimiser may have changed it
        shape = any(part.requires_grad or varies(part) for part in (mesh.vertices, mesh.brightness))
        plain = behind.dtype == torch.float64 or mesh.vertices.device.type != "cpu"
        if shape or plain or (isinstance(background, Tensor) and varies(background)):
            corners = corner_brightness(mesh, self._smoothing, self.light) if shape else self._lit
            step, method = self.supersampling, self.method
            return render_steps(mesh, corners, self.edges, poses.double(), self.camera, behind, step, method)[:, None]
        inputs = poses.double(), behind, self, varies(poses)
        images: Tensor = _Picture.apply(*inputs)[0]  # type: ignore[no-untyped-call]
        return images[:, None]

    def _background(self, background: float | Tensor, poses: Tensor) -> Tensor:
        height, width = self.camera.height, self.camera.width
        if not isinstance(background, Tensor):
            if not 0 <= background <= 1:
                raise ValueError(f"the background must lie in 0…1, got {background}")
            return torch.full((1, height, width), float(background), device=poses.device)
        if background.shape not in ((1, 1, height, width), (len(poses), 1, height, width)):
            raise ValueError(
                f"the background must be a number or have shape (1 or {len(poses)}, 1, {height}, {width}), "
                f"got {tuple(background.shape)}"
            )
        if background.dtype not in (torch.float32, torch.float64):
            raise ValueError(f"the background must be float32 or float64, got {background.dtype}")
        low, high = background.detach().aminmax()
        if not (low >= -_ROUNDING and high <= 1 + _ROUNDING):  # NaN fails too
            raise ValueError(f"the background must lie in 0…1, got {float(low)}…{float(high)}")
        return background[:, 0]


def varies(tensor: Tensor) -> bool:
    """Whether it is differentiated by, in reverse or forward mode."""
    dual = torch.autograd.forward_ad.unpack_dual(tensor)  # type: ignore[no-untyped-call]
    return (tensor.requires_grad and torch.is_grad_enabled()) or dual.tangent is not None


def render(
    mesh: Mesh,
    poses: Tensor,
    camera: Camera,
    *,
    background: float | Tensor = 1.0,
    light: Light = LIGHT,
    method: Method = "edges",
    supersampling: int = SUPERSAMPLING,
) -> Tensor:
    """Images (B, 1, H, W) in 0…1 of a mesh at poses (B, 6), differentiable in poses, mesh and background.

    It is :class:`Renderer`, which prepares the mesh, called once; arguments and errors are described there.
    """
    return Renderer(mesh, camera, light=light, method=method, supersampling=supersampling)(poses, background)


class _Picture(torch.autograd.Function):
    """The compiled rendering: poses (B, 6), a background, a renderer and whether poses vary to images (B, H, W), and
    their motion as :class:`.kernels.rigid.Picture` has it."""

    @staticmethod
    def forward(poses: Tensor, background: Tensor, renderer: Renderer, derivative: bool) -> tuple[Tensor, Tensor]:
        image, motion = renderer.rigid.draw(poses, background, derivative)
        return image.clamp_(0, 1), motion

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(output[1])
        ctx.save_for_backward(inputs[0], output[1])
        ctx.save_for_forward(inputs[0], output[1])
        ctx.camera = inputs[2].camera

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor | None, _: None) -> tuple[Tensor | None, None, None, None]:
        poses, motion = ctx.saved_tensors
        return (None if given is None else pull_back(given, motion, poses, ctx.camera).to(poses)), None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *_: None) -> tuple[Tensor | None, None]:
        if tangent is None:
            return None, None
        poses, motion = ctx.saved_tensors
        jacobian = pose_jacobian(motion, poses, ctx.camera)
        return torch.einsum("bk,bkhw->bhw", tangent.to(jacobian), jacobian), None

    @staticmethod
    def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[tuple[Tensor, Tensor], tuple[None, None]]:
        # poses themselves cannot be mapped over, since their numbers are looked at: tangents are, by jacfwd
        return _Picture.apply(*inputs), (None, None)  # type: ignore[no-untyped-call]


def _rays(poses: Tensor, camera: Camera, like: Tensor) -> tuple[Tensor, Tensor]:
    """x / depth and y / depth of the middles of pixels, (B, 1, W) and (B, H, 1)."""
    x = torch.arange(camera.width, device=poses.device) + 0.5 - camera.width / 2 - poses[:, 4:5]
    y = torch.arange(camera.height, device=poses.device) + 0.5 - camera.height / 2 - poses[:, 5:6]
    return (x / camera.focal).to(like)[:, None, :], (y / camera.focal).to(like)[:, :, None]


def pose_jacobian(moved: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Derivatives (B, 6, H, W) of images by their poses (B, 6): per degree, unit of the mesh or pixel.

    ``moved`` is their motion (B, 4, H, W), as ``Renderer.rigid.draw`` finds it in the same pass as the images.

    A point at depth 1 / w that moves by ω x X + τ moves on the screen by a + b w, where a depends on ω and the ray
    through the pixel, taken in its middle, and b on τ and the ray.
    """
    turn, move, shift = (part.to(moved)[..., None, None] for part in motion(poses))
    x, y = (part[:, None] for part in _rays(poses, camera, moved))
    (tx, ty, tz), (mx, my, mz) = turn.unbind(2), move.unbind(2)
    towards = tx * y - ty * x
    focal = camera.focal
    along_x = focal * (ty - tz * y - x * towards) + shift[:, :, 0]
    along_y = focal * (tz * x - tx - y * towards) + shift[:, :, 1]
    near_x, near_y = focal * (mx - x * mz), focal * (my - y * mz)
    first, second, third, fourth = moved[:, None].unbind(2)
    return along_x * first + near_x * second + along_y * third + near_y * fourth


def pull_back(given: Tensor, moved: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """The adjoint of :func:`pose_jacobian`: images (B, H, W) to poses (B, 6).

    a and b are polynomials in the ray, so that few sums over pixels serve all parameters.
    """
    sums = moments(given, moved, *_rays(poses, camera, moved))
    try:
        return torch.from_numpy(by_pose(sums.numpy(), poses.detach().double().numpy(), camera.focal)).to(moved)
    except RuntimeError:  # inside a function transform tensors have numbers but show no memory
        pass
    turn, move, shift = motion(poses.double())
    # [..., m, n] is with x^m y^n
    along_x, near_x, along_y, near_y = sums.unbind(1)
    by_turn = [
        -along_x[:, 1, 1] - along_y[:, 0, 0] - along_y[:, 0, 2],
        along_x[:, 0, 0] + along_x[:, 2, 0] + along_y[:, 1, 1],
        along_y[:, 1, 0] - along_x[:, 0, 1],
    ]
    by_move = [near_x[:, 0, 0], near_y[:, 0, 0], -near_x[:, 1, 0] - near_y[:, 0, 1]]
    by_shift = [along_x[:, 0, 0], along_y[:, 0, 0]]
    motions = torch.cat([camera.focal * turn, camera.focal * move, shift], 2)
    return (motions @ torch.stack(by_turn + by_move + by_shift, 1)[..., None])[..., 0].to(moved)
