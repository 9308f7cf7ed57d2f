"""Poses and cameras in the conventions of other programs: PASCAL3D+, pytorch3d, and 4×4 matrices.

In the first two azimuth is an angle about the object's upright axis, and elevation one above its horizontal plane.
They differ in where azimuth 0 is:

=============  ==========================  =======================  ==========================
convention     azimuth 0: the camera at    azimuth 90: at           the object's up
=============  ==========================  =======================  ==========================
ours           -y, in front of the object  +x                       +z
PASCAL3D+      -y                          +x                       +z
pytorch3d      +z                          +x                       +y
=============  ==========================  =======================  ==========================

A pose turns the object on the optical axis and then moves its image (:mod:`.camera`): the camera looks straight at the
object, and the principal point moves.  A real camera has one principal point and sees the object along a ray at an
angle to its optical axis.  :func:`turn_to` is the rotation between the two cameras.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

import torch
from torch import Tensor

from ..inputs.numbers import as_size, check_choice, check_type
from ..inputs.tensors import check_shape
from .camera import Camera, check_camera, check_poses, rotations
from .camera import pose as make_pose
from .mesh import Mesh

MatrixConvention: TypeAlias = Literal["opencv", "opengl"]

VIEWPORT = 3000.0
"""Pixels of PASCAL3D+'s viewport: its focal lengths are in units of this."""

_Y_UP = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))  # (x, y, z) of ours is (x, z, -y) of pytorch3d's world
_LEFT_UP = (-1.0, -1.0, 1.0)  # pytorch3d's camera frame: x left, y up, z forward


class Pascal3D(NamedTuple):
    """A viewpoint as PASCAL3D+ annotates it.

    Attributes:
        azimuth, elevation, theta: degrees; theta turns the picture counter-clockwise.
        distance: in units of the CAD model.
        focal: in units of :data:`VIEWPORT`.
        px, py: projection of the object's origin in the whole photograph, in pixels; as in MATLAB, the middle of the
            first pixel is at 1.
    """

    azimuth: float
    elevation: float
    distance: float
    theta: float
    focal: float
    px: float
    py: float


def from_pascal3d(view: Pascal3D, height: int, width: int) -> tuple[Tensor, Camera]:
    """The pose (1, 6), float64, and the camera of an image of ``height`` x ``width`` pixels.

    The CAD models of PASCAL3D+ are in our object frame.  For a :meth:`~.mesh.Mesh.normalized` model, divide the
    distance by the diagonal of the model's bounding box.  For a part of a photograph, subtract its left and upper edge
    from px and py.

    Args:
        view: the annotation; angles in degrees, px and py in pixels from 1.
        height, width: the size of the image, pixels.

    Raises:
        ValueError: a number is not finite, or the distance or the focal length is not above 0: coarse viewpoints have
            none.

    >>> from nablahog.render import Pascal3D, from_pascal3d
    >>> view = Pascal3D(azimuth=30.0, elevation=10.0, distance=5.0, theta=0.0, px=250.5, py=188.0, focal=1.0)
    >>> pose, camera = from_pascal3d(view, height=375, width=500)
    >>> pose.tolist(), camera.focal
    ([[30.0, 10.0, 5.0, 0.0, 0.0, 0.0]], 3000.0)
    """
    check_type("view", view, Pascal3D)
    x, y = view.px - 0.5 - width / 2, view.py - 0.5 - height / 2
    poses = make_pose(view.azimuth, view.elevation, view.distance, view.theta, x, y)
    check_poses(poses)
    return poses, Camera(view.focal * VIEWPORT, height, width)


def to_pascal3d(pose: Tensor, camera: Camera) -> Pascal3D:
    """The annotation from which :func:`from_pascal3d` makes ``pose`` (1, 6) and ``camera``.

    Args:
        pose: (1, 6), degrees.
        camera: the camera of the image.

    Raises:
        ValueError: ``pose`` is no finite (1, 6) tensor with a distance above 0.

    >>> from nablahog.render import pose, to_pascal3d
    >>> view = to_pascal3d(pose(azimuth=30, distance=5), nablahog.Camera(focal=3000, height=375, width=500))
    >>> view.azimuth, view.px, view.py, view.focal  # PASCAL counts pixels from 1
    (30.0, 250.5, 188.0, 1.0)
    """
    check_poses(pose)
    check_camera(camera)
    if len(pose) != 1:
        raise ValueError(f"expected one pose (1, 6), got shape {tuple(pose.shape)}")
    azimuth, elevation, distance, theta, x, y = pose[0].tolist()
    focal = camera.focal / VIEWPORT
    px, py = x + camera.width / 2 + 0.5, y + camera.height / 2 + 0.5
    return Pascal3D(azimuth, elevation, distance, theta, focal, px, py)


def from_pytorch3d(
    rotation: Tensor, translation: Tensor, field_of_view: float, height: int, width: int
) -> tuple[Tensor, Camera]:
    """The poses (B, 6), float64, and the camera of pytorch3d's ``FoVPerspectiveCameras(R=, T=, fov=)``.

    A point X of the world, a row, is X R + T in the camera frame (x left, y up, z forward).  The world is that of its
    ``look_at_view_transform``: y up, the object's front to +z; our (x, y, z) is (x, z, -y) there.

    Args:
        rotation: R, (B, 3, 3).
        translation: T, (B, 3): (0, 0, distance), since the camera looks at the origin.
        field_of_view: degrees along the image's shorter side.
        height, width: the size of the image in pixels.

    Raises:
        ValueError: R is not a rotation, T is not (0, 0, distance > 0), or not 0 < field_of_view < 180.

    >>> from nablahog.render import from_pytorch3d, pose, to_pytorch3d
    >>> rotation, translation, fov = to_pytorch3d(pose(azimuth=30, distance=3), nablahog.Camera(100, 64, 64))
    >>> poses, camera = from_pytorch3d(rotation, translation, fov, 64, 64)
    >>> bool((poses - pose(azimuth=30, distance=3)).abs().max() < 1e-6)
    True
    """
    check_shape("R", rotation, ("B", 3, 3))
    check_shape("T", translation, (len(rotation), 3))
    height, width = as_size("the image", (height, width))
    rotation, translation = rotation.double(), translation.double()
    identity = rotation @ rotation.transpose(1, 2)
    unit = torch.eye(3, dtype=rotation.dtype, device=rotation.device).expand_as(identity)
    if not torch.allclose(identity, unit, atol=1e-4) or not bool((torch.linalg.det(rotation) > 0).all()):
        raise ValueError("R must be rotations: orthogonal, with a determinant of 1")
    distance = translation[:, 2]
    if not bool((translation[:, :2].abs() <= 1e-4 * distance[:, None]).all()):
        raise ValueError("the cameras must look at the origin from a distance above 0: T = (0, 0, distance)")
    ours = rotation.new_tensor(_LEFT_UP)[:, None] * rotation.transpose(1, 2) @ rotation.new_tensor(_Y_UP)
    zero = torch.zeros_like(distance)
    azimuth, elevation, theta = angles(ours)
    poses = torch.stack([azimuth, elevation, distance, theta, zero, zero], dim=1)
    check_poses(poses)
    focal = Camera.from_field_of_view(field_of_view, min(height, width), min(height, width)).focal
    return poses, Camera(focal, height, width)


def to_pytorch3d(poses: Tensor, camera: Camera) -> tuple[Tensor, Tensor, float]:
    """R (B, 3, 3), T (B, 3), both float64, and fov in degrees: what :func:`from_pytorch3d` takes.

    Args:
        poses: (B, 6), degrees.
        camera: the camera of the images.

    Raises:
        ValueError: ``poses`` is no finite (B, 6) tensor with distances above 0, or its x and y are not 0, which this
            camera cannot express.

    >>> from nablahog.render import pose, to_pytorch3d
    >>> rotation, translation, fov = to_pytorch3d(pose(azimuth=0, distance=3), nablahog.Camera(32, 64, 64))
    >>> translation.tolist(), round(fov, 6)
    ([[0.0, 0.0, 3.0]], 90.0)
    """
    check_poses(poses)
    check_camera(camera)
    if bool((poses[:, 4:] != 0).any()):
        raise ValueError("the camera must look at the object's origin: x and y must be 0")
    poses = poses.double()
    turned = rotations(poses).transpose(1, 2) * poses.new_tensor(_LEFT_UP)
    translation = torch.nn.functional.pad(poses[:, 2:3], (2, 0))
    field_of_view = math.degrees(2 * math.atan(min(camera.height, camera.width) / 2 / camera.focal))
    return poses.new_tensor(_Y_UP) @ turned, translation, field_of_view


def angles(rotation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Azimuth, elevation and theta of :func:`.camera.rotations` (B, 3, 3), in degrees.

    Seen from straight above or below, azimuth and theta are not unique; this is one pair of many.
    """
    right, forward = rotation[:, 0], rotation[:, 2]
    azimuth = torch.atan2(-forward[:, 0], forward[:, 1])
    elevation = torch.atan2(-forward[:, 2], torch.hypot(forward[:, 0], forward[:, 1]))
    sa, ca, se, ce = azimuth.sin(), azimuth.cos(), elevation.sin(), elevation.cos()
    level = torch.stack([ca, sa, torch.zeros_like(sa)], dim=1)
    down = torch.stack([se * sa, -se * ca, -ce], dim=1)
    theta = torch.atan2((right * down).sum(1), (right * level).sum(1))
    return torch.rad2deg(azimuth), torch.rad2deg(elevation), torch.rad2deg(theta)


def turn_to(ray: Tensor) -> Tensor:
    """The smallest rotation (3, 3) of a camera after which it looks along a ray (3,), z above 0: rows are its axes."""
    x, y, z = (ray / ray.norm()).unbind()
    a, b, c = x * x / (1 + z), x * y / (1 + z), y * y / (1 + z)
    return torch.stack([torch.stack([1 - a, -b, -x]), torch.stack([-b, 1 - c, -y]), torch.stack([x, y, z])])


def pose_matrix(pose: Tensor) -> Tensor:
    """(4, 4), float64: from the object's frame to that of a camera that looks straight at it, at a pose (6,)."""
    matrix = torch.eye(4, dtype=torch.float64, device="cpu")
    matrix[:3, :3] = rotations(pose[None].double())[0]
    matrix[2, 3] = pose[2]
    return matrix


def convert_matrix(matrix: Tensor, convention: MatrixConvention) -> Tensor:
    """A matrix (4, 4) to OpenCV's camera frame (x right, y down, z forward), or to OpenGL's (y up, z backward)."""
    check_choice("convention", convention, MatrixConvention)
    return matrix if convention == "opencv" else matrix.new_tensor([1, -1, -1, 1])[:, None] * matrix


def move_before_camera(
    mesh: Mesh, matrix: Tensor, intrinsics: Tensor, height: int, width: int
) -> tuple[Mesh, Tensor, Camera]:
    """Arguments for :func:`.renderer.render` to draw a mesh as a pinhole camera sees it: mesh, pose (1, 6), camera.

    A renderer's object is on the optical axis; this one is moved within its frame until its origin is.

    Args:
        mesh: in the frame that ``matrix`` maps to the camera's.
        matrix: (4, 4), rigid, OpenCV's convention, float64.
        intrinsics: (3, 3), of square pixels, float64.
        height, width: the size of the image, pixels.
    """
    rotation, translation = matrix[:3, :3], matrix[:3, 3]
    aside = translation * translation.new_tensor([1, 1, 0])
    azimuth, elevation, theta = (float(angle) for angle in angles(rotation[None]))
    x, y = (intrinsics[:2, 2] - intrinsics.new_tensor([width, height]) / 2).tolist()
    moved = Mesh(mesh.vertices + aside @ rotation, mesh.faces, mesh.brightness)
    camera = Camera(float(intrinsics[0, 0]), height, width)
    return moved, make_pose(azimuth, elevation, float(translation[2]), theta, x, y), camera
