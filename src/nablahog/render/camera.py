"""Cameras and poses: projection of points of an object to the image, and derivatives of images by poses.

Object frame (PASCAL3D+): z up, the front looks to -y.  Camera frame: x right, y down, z along the optical axis.  Pixel
(row i, column j) is the square [j, j+1] x [i, i+1] of the image plane, so that its centre is at (j + ½, i + ½).
"""

from __future__ import annotations

import math
from ctypes import c_bool, c_double, c_int64
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .. import native
from ..inputs.numbers import LONGEST_SIDE, as_integer, as_number
from ..inputs.tensors import advise_on_tensor, check_dense, check_shape, check_values

_REALS, _DOUBLES = native.array(np.float32, np.float64), native.array(np.float64)
_rotations = native.function("rotations", _DOUBLES, c_int64, _DOUBLES)
_pose_vjp = native.function("pose_vjp", c_bool, _REALS, _REALS, _DOUBLES, c_int64, c_double, c_int64, c_int64, _DOUBLES)

PARAMETERS = ("azimuth", "elevation", "distance", "theta", "x", "y")
"""The columns of a tensor of poses (B, 6).

azimuth, elevation: degrees; direction from the object to the camera: azimuth 0 is in front of it, 90 at +x.
distance: from the camera to the object's origin, in units of the mesh; above 0.
theta: degrees; rotation of the image about the optical axis, counter-clockwise.
x, y: pixels; translation of the image to the right and down.
"""


def pose(
    azimuth: float, elevation: float = 0.0, distance: float = 3.0, theta: float = 0.0, x: float = 0.0, y: float = 0.0
) -> Tensor:
    """One pose as a tensor (1, 6), float64; the columns are :data:`PARAMETERS`.

    Args:
        azimuth, elevation, theta: degrees.
        distance: from the camera to the object's origin, units of the mesh.
        x, y: pixels, to the right and down.

    >>> from nablahog.render import pose
    >>> pose(azimuth=30, elevation=15, distance=2.5)
    tensor([[30.0000, 15.0000,  2.5000,  0.0000,  0.0000,  0.0000]],
           dtype=torch.float64)
    """
    values = azimuth, elevation, distance, theta, x, y
    numbers = [as_number(name, value) for name, value in zip(PARAMETERS, values, strict=True)]
    return torch.tensor([numbers], dtype=torch.float64, device="cpu")


@dataclass(frozen=True)
class Camera:
    """A pinhole camera whose optical axis meets the middle of the image.

    Source: the camera C of Section 3.2, f(V, A, C).

    >>> from nablahog.render import Camera
    >>> camera = Camera.from_field_of_view(45, height=128, width=96)
    >>> round(camera.focal, 1)  # pixels
    154.5

    Attributes:
        focal: focal length in pixels.
        height, width: the size of the image in pixels.

    Raises:
        ValueError: one of these is not above 0, or a side is no integer of at most 1,000,000.
    """

    focal: float
    height: int
    width: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal", as_number("focal, in pixels,", self.focal, above=0))
        for side in ("height", "width"):
            object.__setattr__(self, side, as_integer(side, getattr(self, side), 1, LONGEST_SIDE))

    @classmethod
    def from_field_of_view(cls, degrees: float, height: int, width: int) -> Camera:
        """The camera with a vertical field of view of ``degrees``.

        Raises:
            ValueError: not 0 < degrees < 180.
        """
        degrees = as_number("the field of view, in degrees,", degrees, above=0, below=180)
        height = as_integer("height", height, 1, LONGEST_SIDE)
        return cls(height / 2 / math.tan(math.radians(degrees) / 2), height, width)


def check_camera(camera: object) -> Camera:
    """``camera``; TypeError with what to write, if it is none."""
    if isinstance(camera, Camera):
        return camera
    came = type(camera).__name__
    raise TypeError(f"expected a nablahog.Camera, got a {came}: write nablahog.Camera(focal, height, width), in pixels")


def check_poses(poses: Tensor) -> None:
    """Raises ValueError unless ``poses`` is a finite (B, 6) floating point tensor, B ≥ 1, with distances above 0."""
    is_tensor = isinstance(poses, Tensor)
    if not is_tensor or poses.dim() != 2 or not len(poses) or poses.shape[1] != 6 or not poses.is_floating_point():
        got = f"{poses.dtype} of shape {tuple(poses.shape)}" if is_tensor else type(poses).__name__
        write = advise_on_tensor("poses", poses)
        raise ValueError(f"poses must be a floating point tensor (B, 6) of {', '.join(PARAMETERS)}, got {got}{write}")
    check_dense("poses", poses)
    check_values("poses", poses)
    if not torch.isfinite(poses).all() or not (poses[:, 2] > 0).all():
        raise ValueError("poses must be finite, and their distances above 0")


def rotations(poses: Tensor) -> Tensor:
    """Rotations (B, 3, 3) from the object frame to the camera frame at poses (B, 6); differentiable.

    Their rows are the camera's axes right, down and forward.
    """
    azimuth, elevation, theta = (torch.deg2rad(poses[:, k]) for k in (0, 1, 3))
    sa, ca, se, ce = azimuth.sin(), azimuth.cos(), elevation.sin(), elevation.cos()
    zero = torch.zeros_like(sa)
    right = torch.stack([ca, sa, zero], dim=-1)
    down = torch.stack([se * sa, -se * ca, -ce], dim=-1)
    forward = torch.stack([-ce * sa, ce * ca, -se], dim=-1)
    st, ct = theta.sin()[:, None], theta.cos()[:, None]
    return torch.stack([ct * right + st * down, ct * down - st * right, forward], dim=1)


def rotation_matrices(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """As :func:`rotations`, without a derivative: PyTorch's operations would take longer than a small rendering."""
    if not native.available():
        matrices: NDArray[np.float64] = rotations(torch.from_numpy(poses)).numpy()
        return matrices
    matrices = np.empty((len(poses), 3, 3))
    _rotations(np.ascontiguousarray(poses), len(poses), matrices)
    return matrices


def to_camera(points: Tensor, poses: Tensor) -> Tensor:
    """Points (V, 3) of the object to points (B, V, 3) in the camera frames at poses (B, 6); differentiable.

    Both are of one floating point type; units are those of the mesh.
    """
    turned = points @ rotations(poses).transpose(1, 2)
    return turned + torch.nn.functional.pad(poses[:, None, 2:3], (2, 0))


def to_screen(points: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Projects points (B, V, 3) in the camera frames of poses (B, 6) to (B, V, 3): x and y in pixels, and 1 / depth.

    Differentiable.  Points behind the camera have a negative depth; points at depth 0 are at infinity.
    """
    inverse = 1 / points[..., 2:]
    middle = points.new_tensor([camera.width / 2, camera.height / 2]) + poses[:, None, 4:6]
    return torch.cat([camera.focal * points[..., :2] * inverse + middle, inverse], dim=-1)


def pose_velocities(poses: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Velocities of a rigid object by each of the six parameters of its pose.

    A point X in the camera frame has the velocity ω x X + τ, and every point of the image a further shift, per degree,
    unit of the mesh, or pixel.

    Returns:
        ω (B, 6, 3), τ (B, 6, 3) and the shift (B, 6, 2) in pixels.
    """
    rotation = rotations(poses)
    angular = poses.new_zeros((len(poses), 6, 3))
    degree = math.pi / 180
    angular[:, 0] = -rotation[:, :, 2] * degree  # the camera turns about the object's z axis: the object turns back
    theta = torch.deg2rad(poses[:, 3])
    angular[:, 1, 0], angular[:, 1, 1] = theta.cos() * degree, -theta.sin() * degree
    angular[:, 3, 2] = -degree
    centre = torch.nn.functional.pad(poses[:, None, 2:3], (2, 0)).expand_as(angular)
    linear = -torch.linalg.cross(angular, centre)  # the object turns about its own origin
    linear[:, 2, 2] = 1
    shift = poses.new_zeros((len(poses), 6, 2))
    shift[:, 4, 0] = shift[:, 5, 1] = 1
    return angular, linear, shift


def _rays(poses: Tensor, camera: Camera, like: Tensor) -> tuple[Tensor, Tensor]:
    """x / depth and y / depth of the middles of pixels, (B, 1, W) and (B, H, 1)."""
    x = torch.arange(camera.width, dtype=poses.dtype, device=poses.device) + 0.5 - camera.width / 2 - poses[:, 4:5]
    y = torch.arange(camera.height, dtype=poses.dtype, device=poses.device) + 0.5 - camera.height / 2 - poses[:, 5:6]
    return (x / camera.focal).to(like)[:, None, :], (y / camera.focal).to(like)[:, :, None]


def _check_product(screen_gradient: Tensor, poses: Tensor, camera: Camera) -> None:
    check_camera(camera)
    check_shape("poses", poses, ("B", len(PARAMETERS)))
    check_shape("screen_gradient", screen_gradient, (len(poses), 4, camera.height, camera.width))


def pose_jacobian(screen_gradient: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Jacobian (B, 6, H, W) of images with respect to poses (B, 6): per degree, unit of the mesh, or pixel.

    A point X at 1 / depth = w with the velocity ω x X + τ moves on the screen by a + b w.  a depends on ω and on the
    ray through the middle of the pixel, b on τ and on the ray.

    Args:
        screen_gradient: (B, 4, H, W), of :class:`.renderer.Rendering`.
        poses, camera: those of the images.

    Raises:
        TypeError: one is no dense tensor, or no camera.
        ValueError: one has another shape.

    >>> from nablahog.render import Renderer, pose, pose_jacobian
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 32, 32)
    >>> poses = pose(azimuth=30, distance=3)
    >>> drawn = Renderer(mesh, camera).render(poses, derivative=True)
    >>> pose_jacobian(drawn.screen_gradient, poses, camera).shape
    torch.Size([1, 6, 32, 32])
    """
    _check_product(screen_gradient, poses, camera)
    angular, linear, shift = (part.to(screen_gradient)[..., None, None] for part in pose_velocities(poses))
    x, y = (part[:, None] for part in _rays(poses, camera, screen_gradient))
    (wx, wy, wz), (tx, ty, tz) = angular.unbind(2), linear.unbind(2)
    forward = wx * y - wy * x
    focal = camera.focal
    a_x = focal * (wy - wz * y - x * forward) + shift[:, :, 0]
    a_y = focal * (wz * x - wx - y * forward) + shift[:, :, 1]
    b_x, b_y = focal * (tx - x * tz), focal * (ty - y * tz)
    by_a_x, by_b_x, by_a_y, by_b_y = screen_gradient[:, None].unbind(2)
    return a_x * by_a_x + b_x * by_b_x + a_y * by_a_y + b_y * by_b_y


def pose_vjp(grad_image: Tensor, screen_gradient: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Gradient (B, 6) with respect to poses: the product of ``grad_image`` (B, H, W) and :func:`pose_jacobian`.

    Args:
        grad_image: gradient with respect to the images.
        screen_gradient, poses, camera: as for :func:`pose_jacobian`.

    Raises:
        TypeError, ValueError: as :func:`pose_jacobian`.

    >>> from nablahog.render import Renderer, pose, pose_vjp
    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 32, 32)
    >>> poses = pose(azimuth=30, distance=3)
    >>> drawn = Renderer(mesh, camera).render(poses, derivative=True)
    >>> pose_vjp(torch.ones(1, 32, 32), drawn.screen_gradient, poses, camera).shape
    torch.Size([1, 6])
    """
    _check_product(screen_gradient, poses, camera)
    check_shape("grad_image", grad_image, (len(poses), camera.height, camera.width))
    is_recorded = grad_image.requires_grad and torch.is_grad_enabled()
    if native.can_read(grad_image, screen_gradient, poses) and not is_recorded:
        images, gradients = grad_image.to(screen_gradient).contiguous(), screen_gradient.contiguous()
        double, numbers = gradients.dtype == torch.float64, poses.detach().double().contiguous()
        grad_poses = torch.empty_like(numbers)
        _pose_vjp(
            double, images, gradients, numbers, len(numbers), camera.focal, camera.height, camera.width, grad_poses
        )
        return grad_poses.to(screen_gradient)
    jacobian = pose_jacobian(screen_gradient.double(), poses, camera)
    return torch.einsum("bkhw,bhw->bk", jacobian, grad_image.double()).to(screen_gradient)
