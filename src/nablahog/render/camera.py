"""Cameras and poses: from points of an object to points of an image, and how these move with the pose.

Object frame (PASCAL3D+): z up, the front looks to -y.  Camera frame: x right, y down, z along the optical axis.  Pixel
(row i, column j) is the square [j, j+1] x [i, i+1] of the image plane, so that its centre is at (j + ½, i + ½).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

PARAMETERS = ("azimuth", "elevation", "distance", "theta", "x", "y")
"""The columns of a tensor of poses (B, 6).

azimuth, elevation: of the camera, seen from the object, in degrees: at azimuth 0 it sees the front, at 90 it is at +x.
distance: from the camera to the object's origin, in units of the mesh.
theta: degrees that the picture is turned counter-clockwise about the optical axis.
x, y: pixels that the picture is moved right and down.
"""


def pose(
    azimuth: float, elevation: float = 0.0, distance: float = 3.0, theta: float = 0.0, x: float = 0.0, y: float = 0.0
) -> Tensor:
    """One pose as a tensor (1, 6), float64."""
    return torch.tensor([[azimuth, elevation, distance, theta, x, y]], dtype=torch.float64)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera whose optical axis meets the middle of the image.

    Attributes:
        focal: focal length in pixels.
        height, width: of the image in pixels.

    Raises:
        ValueError: one of these is not above 0.
    """

    focal: float
    height: int
    width: int

    def __post_init__(self) -> None:
        if not (0 < self.focal < math.inf):
            raise ValueError(f"the focal length must be a finite number of pixels above 0, got {self.focal!r}")
        if self.height < 1 or self.width < 1:
            raise ValueError(f"an image has at least 1x1 pixels, got {self.height}x{self.width}")

    @classmethod
    def from_field_of_view(cls, degrees: float, height: int, width: int) -> Camera:
        """The camera that sees ``degrees`` from the top of the image to its bottom.

        Raises:
            ValueError: not 0 < degrees < 180.
        """
        if not 0 < degrees < 180:
            raise ValueError(f"the field of view must lie between 0 and 180 degrees, got {degrees!r}")
        return cls(height / 2 / math.tan(math.radians(degrees) / 2), height, width)


def check_poses(poses: Tensor) -> None:
    """Raises ValueError unless ``poses`` is a finite (B, 6) floating point tensor, B ≥ 1, with distances above 0."""
    if poses.dim() != 2 or not len(poses) or poses.shape[1] != len(PARAMETERS) or not poses.is_floating_point():
        raise ValueError(
            f"poses must be a floating point tensor (B, 6) of {', '.join(PARAMETERS)}, "
            f"got {poses.dtype} of shape {tuple(poses.shape)}"
        )
    if not torch.isfinite(poses).all() or not (poses[:, 2] > 0).all():
        raise ValueError("poses must be finite, and their distances above 0")


def rotations(poses: Tensor) -> Tensor:
    """Poses (B, 6) to (B, 3, 3), which turn the object frame into the camera frame: their rows are the camera's axes
    right, down and forward.  Differentiable."""
    azimuth, elevation, theta = (torch.deg2rad(poses[:, k]) for k in (0, 1, 3))
    sa, ca, se, ce = azimuth.sin(), azimuth.cos(), elevation.sin(), elevation.cos()
    zero = torch.zeros_like(sa)
    right = torch.stack([ca, sa, zero], dim=-1)
    down = torch.stack([se * sa, -se * ca, -ce], dim=-1)
    forward = torch.stack([-ce * sa, ce * ca, -se], dim=-1)
    st, ct = theta.sin()[:, None], theta.cos()[:, None]
    return torch.stack([ct * right + st * down, ct * down - st * right, forward], dim=1)


def to_camera(points: Tensor, poses: Tensor) -> Tensor:
    """Points (V, 3) of the object to (B, V, 3) in the camera frames of poses (B, 6): x right, y down, z forward, in
    units of the mesh.  Differentiable; both of one floating point type."""
    moved = points @ rotations(poses).transpose(1, 2)
    return moved + torch.nn.functional.pad(poses[:, None, 2:3], (2, 0))


def to_screen(points: Tensor, poses: Tensor, camera: Camera) -> Tensor:
    """Points (B, V, 3) in the camera frames of poses (B, 6) to (B, V, 3): x and y in pixels, and 1 / depth.

    Differentiable.  Points behind the camera have a negative depth; those beside it, at depth 0, are at infinity.
    """
    inverse = 1 / points[..., 2:]
    middle = points.new_tensor([camera.width / 2, camera.height / 2]) + poses[:, None, 4:6]
    return torch.cat([camera.focal * points[..., :2] * inverse + middle, inverse], dim=-1)


def motion(poses: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """How the points of a rigid object move with each of the six parameters (a unit is a degree, a unit of the mesh, or
    a pixel): a point X in the camera frame by ω x X + τ, and every point of the picture by a further shift.

    Returns:
        ω (B, 6, 3), τ (B, 6, 3) and the shift (B, 6, 2) in pixels.
    """
    rotation = rotations(poses)
    turn = poses.new_zeros((len(poses), 6, 3))
    degree = math.pi / 180
    turn[:, 0] = -rotation[:, :, 2] * degree  # the camera goes round the object's z axis, so the object turns back
    theta = torch.deg2rad(poses[:, 3])
    turn[:, 1, 0], turn[:, 1, 1] = theta.cos() * degree, -theta.sin() * degree
    turn[:, 3, 2] = -degree
    centre = torch.nn.functional.pad(poses[:, None, 2:3], (2, 0)).expand_as(turn)
    move = -torch.linalg.cross(turn, centre)  # the object turns about its own origin
    move[:, 2, 2] = 1
    shift = poses.new_zeros((len(poses), 6, 2))
    shift[:, 4, 0] = shift[:, 5, 1] = 1
    return turn, move, shift
