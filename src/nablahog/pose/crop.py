"""The object cut out of its photograph: a small gray square around its box, the same size for every object.

A camera of known focal length and principal point is turned in place until it looks at the middle of the crop: beside
the optical axis a photograph stretches objects, and such a crop shows them as they are rendered.  If the camera is
unknown, the crop is cut out as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from ..inputs.arrays import ArrayImage, as_photograph
from ..inputs.boxes import Box, as_box
from ..render import Camera
from .crop_view import CropView, resample

CROP_SIDE = 128  # pixels of the square
CROP_FILL = 112.0  # pixels of the box's longer side in it
SMALLEST_SIDE = 8  # of a photograph, and of a box that is given, pixels
LARGEST_BOX = 10  # times as large as the photograph, which then fills some 11 pixels of the crop
DISTANCE = 3.0
"""From the camera to the object where nothing is known, in diagonals of its bounding box: as people stand."""
_TYPICAL_EXTENT = 0.85  # longer side of a typical view, in diagonals; the fit to the box corrects the rest


@dataclass(frozen=True, eq=False)
class ObjectCrop(CropView):
    """A square cut-out around the middle of an object's box."""

    image: Tensor  # (1, 1, S, S), float32 in 0…1; beyond the photograph, its border repeats
    size: tuple[float, float]  # (width, height) of the object's box in it, pixels
    camera: Camera  # sees an object at :data:`DISTANCE` about as large as the box
    valid: Box  # where the crop shows the photograph, in pixels of the crop; it may reach beyond the border

    def downsample(self, factor: int) -> ObjectCrop:
        """The crop shrunk by averaging ``factor`` x ``factor`` pixels."""
        width, height = self.size
        return replace(
            self,
            zoom=self.zoom / factor,
            image=functional.avg_pool2d(self.image, factor),
            size=(width / factor, height / factor),
            camera=downsample_camera(self.camera, factor),
            valid=Box(*(side / factor for side in self.valid)),
        )

    def turn_quarters(self, count: int) -> ObjectCrop:
        """The crop turned by ``count`` quarters of a turn counter-clockwise; only its image and where that is valid."""
        side, valid = self.image.shape[-1], self.valid
        for _ in range(count):
            valid = Box(valid.y0, side - valid.x1, valid.y1, side - valid.x0)
        return replace(self, image=self.image.rot90(count, (2, 3)), valid=valid)

    def convert_pose(self, pose: Tensor, other: ObjectCrop) -> Tensor:
        """A pose (6,) for this crop, converted to another crop of the same photograph by the same camera."""
        moved = pose.clone()
        moved[4], moved[5] = other.from_photograph(*map(float, self.to_photograph(pose[4], pose[5])))
        if self.axis is not None:
            moved[3] += self.twist(float(pose[4]), float(pose[5])) - other.twist(*moved[4:].tolist())
        return moved

    def box_in_photograph(self, box: Tensor) -> Box:
        """The photograph's box through the middles of the sides of a box (4,) relative to the crop's middle."""
        x0, y0, x1, y1 = box
        middle = (x0 + x1) / 2, (y0 + y1) / 2
        across, down = self.to_photograph(
            torch.stack([x0, middle[0], x1, middle[0]]), torch.stack([middle[1], y0, middle[1], y1])
        )
        return Box(float(across[0]), float(down[1]), float(across[2]), float(down[3]))

    @property
    def centred_box(self) -> Box:
        """The object's, from the middle of the crop, pixels."""
        width, height = self.size
        return Box(-width / 2, -height / 2, width / 2, height / 2)

    def place_in_photograph(self, pose: Tensor, height: int, width: int) -> tuple[Tensor, Camera]:
        """A pose (6,) for this crop as one for the whole photograph of ``height`` x ``width``, with its camera."""
        moved = pose.clone()
        x, y = map(float, self.to_photograph(pose[4], pose[5]))
        moved[3] += self.twist(float(pose[4]), float(pose[5]))
        moved[4], moved[5] = x - width / 2, y - height / 2
        return moved, Camera(self.focal, height, width)


def typical_camera(side: int = CROP_SIDE, fill: float = CROP_FILL) -> Camera:
    """The camera that sees an object at :data:`DISTANCE` fill ``fill`` of ``side`` pixels."""
    return Camera(DISTANCE * fill / _TYPICAL_EXTENT, side, side)


def downsample_camera(camera: Camera, factor: int) -> Camera:
    """A camera that sees the same in pixels ``factor`` times as large."""
    return Camera(camera.focal / factor, camera.height // factor, camera.width // factor)


def check_box(
    sides: Sequence[float], height: int, width: int, least: int = SMALLEST_SIDE, most: int = LARGEST_BOX
) -> Box:
    """The box x0, y0, x1, y1.

    Raises:
        ValueError: it is not finite, has fewer than ``least`` pixels a side, lies outside an image of this size, or is
            more than ``most`` times as large.
    """
    box = as_box("the box", sides)
    if not (box.width >= least and box.height >= least):
        sized = Box(box.x0, box.y0, box.x0 + box.x1, box.y0 + box.y1)  # if these are a width and a height
        write = (
            f"; of x, y, width, height write {tuple(sized)}"
            if min(box.width, box.height) < 0 and min(box.x1, box.y1) >= least
            else ""
        )
        if 0 <= min(box) < max(box) <= 1:  # in parts of the sides
            write = (
                f"; of parts of the sides write {(box.x0 * width, box.y0 * height, box.x1 * width, box.y1 * height)}"
            )
        raise ValueError(
            f"the box must be x0, y0, x1, y1 with sides of at least {least} pixels, got {tuple(box)}{write}"
        )
    if box.x1 <= 0 or box.y1 <= 0 or box.x0 >= width or box.y0 >= height:
        raise ValueError(f"a box must overlap the image of {height}x{width} pixels (height x width), got {tuple(box)}")
    if max(box.width, box.height) > most * max(height, width):
        raise ValueError(
            f"a box must be at most {most} times as large as the image of {height}x{width} pixels "
            f"(height x width), got {tuple(box)}"
        )
    return box


def crop_object(
    photograph: Tensor | ArrayImage,
    box: Sequence[float] | None = None,
    side: int = CROP_SIDE,
    fill: float = CROP_FILL,
    focal: float | None = None,
    axis: tuple[float, float] | None = None,
) -> ObjectCrop:
    """The square of ``side`` pixels around a box, shrunk or enlarged so that the box's longer side has ``fill``.

    Args:
        photograph: (C, H, W), float32 or float64 in 0…1, one channel or R, G, B.
        box: x0, y0, x1, y1 of the object, pixels; by default the whole photograph.
        side: of the crop, pixels.
        fill: of the box's longer side, pixels.
        focal: focal length of the photograph's camera, pixels; by default such that an object that fills the box is
            seen from :data:`DISTANCE`.
        axis: where the optical axis meets the photograph, x, y, pixels, if that and the focal length are known, so that
            the crop is what the camera would see if it looked at the box; by default it is cut out as it is.

    Raises:
        ValueError: the photograph is of another shape, holds NaN, or the box is empty or beside it.
    """
    photograph = as_photograph("the photograph", photograph)
    height, width = photograph.shape[1:]
    # boxes that a search finds may be smaller and larger than those that are given
    object_box = check_box((0, 0, width, height) if box is None else box, height, width, least=1, most=10 * LARGEST_BOX)
    zoom = fill / max(object_box.width, object_box.height)
    middle = (object_box.x0 + object_box.x1) / 2, (object_box.y0 + object_box.y1) / 2
    camera = typical_camera(side, fill) if focal is None else Camera(focal * zoom, side, side)
    view = CropView(middle, zoom, camera.focal / zoom, axis)
    size = object_box.width * zoom, object_box.height * zoom
    if axis is not None:  # the turned camera sees the box a little smaller
        turned_box = view.map_box(object_box)
        zoom *= fill / max(turned_box.width, turned_box.height)
        camera = Camera(view.focal * zoom, side, side)
        view = replace(view, zoom=zoom)
        turned_box = view.map_box(object_box)
        size = turned_box.width, turned_box.height
    valid = Box(*(edge + side / 2 for edge in view.map_box(Box(0, 0, width, height))))
    image = resample(photograph, view, side)
    return ObjectCrop(middle, zoom, camera.focal / zoom, axis, image, size, camera, valid)


def apply_mask(photograph: Tensor, mask: Tensor, box: Box | None = None) -> tuple[Tensor, Box]:
    """The photograph with nothing around the object, and the object's box.

    Pixels around the object get the photograph's mean, so that no edge is left there but the object's own outline.

    Args:
        photograph: (C, H, W), floating point or uint8.
        mask: (H, W), bool, true where the object is, somewhere.
        box: the object's; by default that of the mask.
    """
    if box is None:
        rows, cols = mask.any(1).nonzero(), mask.any(0).nonzero()
        box = Box(float(cols.min()), float(rows.min()), float(cols.max()) + 1, float(rows.max()) + 1)
    mean = photograph.mean(dtype=torch.float32)
    if photograph.dtype == torch.uint8:
        mean = mean.round()
    return torch.where(mask, photograph, mean.to(photograph.dtype)), box
