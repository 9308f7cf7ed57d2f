"""An object anywhere before a pinhole camera as a 4×4 matrix, the form that other programs read.

A pose turns the object on the optical axis and then moves its image (:mod:`.camera`): the camera looks straight at the
object, and the principal point moves.  A real camera has one principal point and sees the object along a ray at an
angle to its optical axis.  :func:`turn_to` is the rotation between the two cameras.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import torch
from torch import Tensor

from .camera import Camera, rotations
from .camera import pose as one_pose
from .conventions import angles
from .mesh import Mesh

MatrixConvention: TypeAlias = Literal["opencv", "opengl"]


def turn_to(ray: Tensor) -> Tensor:
    """The smallest rotation (3, 3) of a camera after which it looks along a ray (3,): its rows are the new axes.

    Args:
        ray: in the camera's frame, z above 0, of any length.
    """
    x, y, z = (ray / ray.norm()).unbind()
    a, b, c = x * x / (1 + z), x * y / (1 + z), y * y / (1 + z)
    return torch.stack([torch.stack([1 - a, -b, -x]), torch.stack([-b, 1 - c, -y]), torch.stack([x, y, z])])


def pose_matrix(pose: Tensor) -> Tensor:
    """(4, 4), float64: from the object's frame to that of a camera that looks straight at it, at a pose (6,)."""
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = rotations(pose[None].double())[0]
    matrix[2, 3] = pose[2]
    return matrix


def in_convention(matrix: Tensor, convention: MatrixConvention) -> Tensor:
    """A matrix (4, 4) to OpenCV's camera frame (x right, y down, z forward), or to OpenGL's (y up, z backward).

    Raises:
        ValueError: ``convention`` is neither.
    """
    if convention not in get_args(MatrixConvention):
        raise ValueError(f"convention must be 'opencv' or 'opengl', got {convention!r}")
    return matrix if convention == "opencv" else matrix.new_tensor([1, -1, -1, 1])[:, None] * matrix


def moved_before(
    mesh: Mesh, matrix: Tensor, intrinsics: Tensor, height: int, width: int
) -> tuple[Mesh, Tensor, Camera]:
    """What :func:`.renderer.render` takes to draw a mesh as a pinhole camera sees it: a mesh, a pose (1, 6), a camera.

    A renderer's object is on the optical axis; this one is moved within its frame until its origin is.

    Args:
        mesh: in the frame that ``matrix`` maps to the camera's.
        matrix: (4, 4), rigid, OpenCV's convention, float64.
        intrinsics: (3, 3), of square pixels, float64.
        height, width: of the image, pixels.
    """
    rotation, translation = matrix[:3, :3], matrix[:3, 3]
    aside = translation * translation.new_tensor([1, 1, 0])
    azimuth, elevation, theta = (float(angle) for angle in angles(rotation[None]))
    x, y = (intrinsics[:2, 2] - intrinsics.new_tensor([width, height]) / 2).tolist()
    moved = Mesh(mesh.vertices + aside @ rotation, mesh.faces, mesh.brightness)
    camera = Camera(float(intrinsics[0, 0]), height, width)
    return moved, one_pose(azimuth, elevation, float(translation[2]), theta, x, y), camera
