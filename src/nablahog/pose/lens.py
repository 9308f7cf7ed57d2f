"""The camera of a photograph, and the picture of an ideal camera in its place, in which poses are searched."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from torch import Tensor

from ..inputs.boxes import Box
from ..inputs.cameras import PhotographCamera, as_camera, as_distortion
from ..io.arrays import naming
from ..io.camera_file import read_camera_file
from ..io.camera_mapping import CameraFile, read_camera_mapping
from ..io.input_file import InputFile
from ..render import Camera
from ..render.lens import IdealCamera
from .crop import SMALLEST_SIDE
from .options import FocalSource
from .result import PoseEstimate

MOST_UNEQUAL_RATIOS = 0.01  # of the heights and of the widths, where a photograph was resized


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
            box=ideal.map_box_back(moved).widen(SMALLEST_SIDE) if box is None else box,
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
    elif isinstance(intrinsics, Mapping):
        with naming("`intrinsics`"):
            intrinsics = read_camera_mapping(intrinsics)
    if isinstance(intrinsics, CameraFile):
        calibrated = join_distortion(intrinsics, distortion)
        check_camera_size(calibrated, *size)
        intrinsics, distortion = calibrated.intrinsics, calibrated.distortion
    camera = as_camera(*size, focal, principal_point, intrinsics, distortion)
    return Lens(camera, "assumed" if camera is None else source)


def join_distortion(camera: CameraFile, distortion: object) -> CameraFile:
    """The camera of a file with a distortion that is known from elsewhere; None for none.

    Raises:
        ValueError: the file has one, too.
    """
    if distortion is None:
        return camera
    if camera.distortion is not None:
        raise ValueError("`intrinsics` has a distortion: expected no `distortion` beside it")
    return camera._replace(distortion=as_distortion("distortion", distortion))


def check_camera_size(camera: CameraFile, height: int, width: int) -> None:
    """Raises ValueError, which says what to write, if a camera's file is for photographs of another size."""
    if not camera.sizes or (height, width) in camera.sizes:
        return
    size = min(camera.sizes, key=lambda size: abs(math.log(height / size[0] * size[1] / width)))
    high, wide = height / size[0], width / size[1]
    resized = math.isclose(high, wide, rel_tol=MOST_UNEQUAL_RATIOS)
    if size == (width, height):
        write = "turn the photograph as it was taken"
    elif not resized and math.isclose(height / size[1], width / size[0], rel_tol=MOST_UNEQUAL_RATIOS):
        write = "if the photograph was turned, turn it as it was taken"
    elif resized:
        fx, fy, cx, cy = camera.intrinsics
        scaled = ",".join(f"{number:g}" for number in (fx * wide, fy * high, cx * wide, cy * high))
        bent = (
            "" if camera.distortion is None else f" and `distortion`={','.join(map('{:g}'.format, camera.distortion))}"
        )
        write = f"if the photograph was made smaller or larger as a whole, write `intrinsics`={scaled}{bent}"
    else:
        write = (
            "of a photograph that was cut, write `intrinsics` as fx,fy,cx,cy, with what was cut off at the left "
            "subtracted from cx, and at the top from cy"
        )
    raise ValueError(
        f"`intrinsics` is for photographs of {size[0]}x{size[1]} pixels (height x width), got {height}x{width}: {write}"
    )
