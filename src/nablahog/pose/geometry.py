"""The geometry of a pose: as matrices of other conventions, in the units of the model's file, and how exact it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..render import PARAMETERS, Camera
from ..render.conventions import MatrixConvention, convert_matrix, pose_matrix, turn_to
from .covariance import position_covariance


@dataclass(frozen=True, eq=False, repr=False)
class PoseGeometry:
    """What follows from a pose, its camera and the units of its model; :class:`.PoseEstimate` says what each is."""

    azimuth: float
    elevation: float
    distance: float
    theta: float
    x: float
    y: float
    camera: Camera
    principal_point: tuple[float, float] | None = field(default=None, kw_only=True)
    from_original: Tensor = field(default_factory=lambda: torch.eye(4, dtype=torch.float64, device="cpu"), kw_only=True)
    covariance: Tensor | None = field(default=None, kw_only=True)

    @property
    def pose(self) -> Tensor:
        """(1, 6), float64, angles in degrees: what :func:`nablahog.render.render` takes together with ``camera``."""
        values = (self.azimuth, self.elevation, self.distance, self.theta, self.x, self.y)
        return torch.tensor([values], dtype=torch.float64, device="cpu")

    @property
    def distance_in_file_units(self) -> float:
        """From the camera to the middle of the model's bounding box, in the units of its file."""
        return self.distance * self._unit

    @property
    def covariance_in_file_units(self) -> Tensor | None:
        """(6, 6), float64: :attr:`covariance` with the distance in the units of the model's file."""
        if self.covariance is None:
            return None
        units = torch.ones(len(PARAMETERS), dtype=torch.float64, device="cpu")
        units[PARAMETERS.index("distance")] = self._unit
        return self.covariance * torch.outer(units, units)

    @property
    def standard_deviations(self) -> Tensor | None:
        """(6,), float64, of :attr:`pose`: 68 of 100 true parameters are within one of them, if the pose is right."""
        return None if self.covariance is None else self.covariance.diagonal().sqrt()

    @property
    def position(self) -> Tensor:
        """(3,), float64: the middle of the model's bounding box along the camera's axes, in the units of its file.

        The axes are OpenCV's: x right, y down and z forward.
        """
        return self._unit * self._motion[:3, 3]

    @property
    def position_std(self) -> Tensor | None:
        """(3,), float64: standard deviations of :attr:`position`; None where the focal length is assumed, too."""
        if self.covariance is None or self.principal_point is None:
            return None
        covariance = position_covariance(self.covariance, self.distance, self._ray, self.camera.focal)
        return self._unit * covariance.diagonal().sqrt()

    @property
    def intrinsics(self) -> Tensor:
        """(3, 3), float64, pixels: the camera's matrix, which projects what :meth:`matrix` maps to its frame.

        Its principal point is that of the photograph's camera; where that is unknown, the one of a camera that looks
        straight at the object, x and y from the photograph's middle.
        """
        place = self.principal_point or self._place
        focal = self.camera.focal
        return torch.tensor([[focal, 0, place[0]], [0, focal, place[1]], [0, 0, 1]], dtype=torch.float64, device="cpu")

    def matrix(self, convention: MatrixConvention = "opencv") -> Tensor:
        """The rigid motion (4, 4), float64, from the mesh as it is in its file to the camera's frame, in its units.

        With OpenCV's convention, a point X of the file is seen at :attr:`intrinsics` · (R X + t), divided by its last
        coordinate.

        Args:
            convention: of the camera's frame: ``"opencv"``, x right, y down and z forward, or ``"opengl"``, y up and z
                backward.

        Raises:
            ValueError: ``convention`` is neither.
        """
        unit = torch.tensor([self._unit] * 3 + [1], dtype=torch.float64, device="cpu")[:, None]
        return convert_matrix(unit * (self._motion @ self.from_original), convention)

    @property
    def camera_to_world(self) -> Tensor:
        """(4, 4), float64: Blender's ``matrix_world`` of the camera, with the model where Blender's importers put it.

        From the camera's frame, which is OpenGL's (y up, it looks along -z), to a world with z up and the front at -y,
        in the units and with the origin of the model's file.
        """
        world = torch.eye(4, dtype=torch.float64, device="cpu")
        world[:3, :3] = self._unit * self.from_original[:3, :3]
        return world.matmul(self.matrix("opengl").inverse())

    @property
    def _unit(self) -> float:  # the mesh's unit of length, in units of its file
        return 1 / float(self.from_original[:3, 0].norm())

    @property
    def _place(self) -> tuple[float, float]:
        """x, y of the object's origin in the photograph, pixels."""
        return self.camera.width / 2 + self.x, self.camera.height / 2 + self.y

    @property
    def _motion(self) -> Tensor:
        """(4, 4): from the normalised mesh to the frame of the camera."""
        motion = pose_matrix(self.pose[0])
        motion[:3] = turn_to(self._ray).T @ motion[:3]
        return motion

    @property
    def _ray(self) -> Tensor:
        """(3,), float64: from the camera to the object's origin, of depth 1."""
        x, y = (at - axis for at, axis in zip(self._place, self.principal_point or self._place, strict=True))
        return torch.tensor([x / self.camera.focal, y / self.camera.focal, 1.0], dtype=torch.float64, device="cpu")
