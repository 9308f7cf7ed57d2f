"""The camera of a photograph, and the picture of an ideal camera in its place, in which poses are searched."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property

from torch import Tensor

from ..inputs.boxes import Box
from ..inputs.cameras import PhotographCamera, as_camera
from ..io.camera_file import CameraFile, read_camera_file
from ..io.input_file import InputFile
from ..render import Camera
from ..render.lens import IdealCamera
from .options import FocalSource
from .result import PoseEstimate


@dataclass(frozen=True, eq=False)
class Lens:
    """What is known about a photograph's camera.

    Attributes:
        camera: the one that took the photograph; None if its focal length is not known.
        source: where the focal length is from.
    """

    camera: PhotographCamera | None
    source: FocalSource

    @property
    def focal(self) -> float | None:
        """Of the camera that takes :meth:`undistort`'s picture, pixels; None if unknown."""
        return None if self.camera is None else max(self.camera.fx, self.camera.fy)

    @property
    def principal_point(self) -> tuple[float, float] | None:
        """x, y of the optical axis in that picture, pixels; None if unknown."""
        if self._ideal is None:
            return None if self.camera is None else (self.camera.cx, self.camera.cy)
        (x, y), whole = self._ideal.axis, self._ideal.whole
        return x - whole.x0, y - whole.y0

    @cached_property
    def _ideal(self) -> IdealCamera | None:
        """The ideal camera, if the photograph's is none."""
        return None if self.camera is None or self.camera.is_ideal else IdealCamera(self.camera)

    def undistort(self, photograph: Tensor) -> Tensor:
        """All of a photograph (C, H, W), as a camera with square pixels and without distortion would have taken it."""
        return photograph if self._ideal is None else self._ideal.resample(photograph, self._ideal.whole)

    def map_box(self, box: Box) -> Box:
        """A box of the photograph in that picture, pixels."""
        if self._ideal is None:
            return box
        mapped, whole = self._ideal.map_box(box), self._ideal.whole
        return Box(mapped.x0 - whole.x0, mapped.y0 - whole.y0, mapped.x1 - whole.x0, mapped.y1 - whole.y0)

    def report(self, estimate: PoseEstimate, box: Box | None = None) -> PoseEstimate:
        """An estimate for that picture as one for the photograph, with the box that was given there, if one was."""
        rivals = tuple(self.report(rival, box) for rival in estimate.runners_up)
        estimate = replace(estimate, focal_from=self.source, runners_up=rivals)
        if self._ideal is None:
            return estimate
        assert self.camera is not None
        ideal, whole, found = self._ideal, self._ideal.whole, estimate.box
        if box is None and found == (0, 0, whole.width, whole.height):
            box = Box(0.0, 0.0, float(self.camera.width), float(self.camera.height))
        moved = Box(found.x0 + whole.x0, found.y0 + whole.y0, found.x1 + whole.x0, found.y1 + whole.y0)
        return replace(
            estimate,
            x=estimate.x + whole.x0 + (whole.width - ideal.width) / 2,
            y=estimate.y + whole.y0 + (whole.height - ideal.height) / 2,
            camera=Camera(ideal.focal, ideal.height, ideal.width),
            principal_point=ideal.axis,
            photograph_camera=self.camera,
            box=ideal.map_box_back(moved) if box is None else box,
        )


def choose_lens(
    size: tuple[int, int],
    focal: object = None,
    principal_point: object = None,
    intrinsics: object = None,
    distortion: object = None,
    exif: float | None = None,
) -> Lens:
    """What is known about the camera of a photograph.

    Args:
        size: height and width of the photograph, pixels.
        focal, principal_point, intrinsics, distortion: as for :func:`.estimate.estimate_pose`; or as intrinsics a
            camera that was read from a file.
        exif: the focal length in pixels that the photograph's file says; None for none.
    """
    source: FocalSource = "exif" if isinstance(focal, str) and focal == "exif" else "given"
    if source == "exif":
        if exif is None:
            raise ValueError(
                "`focal` 'exif' needs an uncropped photograph (in Python a PIL image) whose EXIF data has one"
            )
        focal = exif
    if isinstance(intrinsics, str | os.PathLike | InputFile):
        intrinsics = read_camera_file(intrinsics)
    if isinstance(intrinsics, CameraFile):
        calibrated = intrinsics.join(distortion)
        calibrated.check_size(*size)
        intrinsics, distortion = calibrated.intrinsics, calibrated.distortion
    camera = as_camera(*size, focal, principal_point, intrinsics, distortion)
    return Lens(camera, "assumed" if camera is None else source)
