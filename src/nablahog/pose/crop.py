"""The object cut out of its photograph: a small gray square around its box, the same size for every object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ..hog.box import Box
from ..hog.gradient import gray
from ..render import Camera

SIDE = 128  # pixels of the square
FILL = 112.0  # pixels of the box's longer side in it
DISTANCE = 3.0
"""From the camera to the object where nothing is known, in diagonals of its bounding box: as people stand."""
_TYPICAL_EXTENT = 0.85  # longer side of a typical view, in diagonals; the fit to the box corrects the rest


@dataclass(frozen=True, eq=False)
class ObjectCrop:
    """A square cut-out around the middle of an object's box.

    Attributes:
        image: (1, 1, S, S), float32 in 0…1; beyond the photograph, its border repeats.
        size: (width, height) of the object's box in it, pixels.
        zoom: pixels of the crop for one of the photograph.
        middle: x, y of its middle in the photograph, pixels.
        camera: sees an object at :data:`DISTANCE` about as large as the box.
        valid: where the crop shows the photograph, in pixels of the crop; it may reach beyond the border.
    """

    image: Tensor
    size: tuple[float, float]
    zoom: float
    middle: tuple[float, float]
    camera: Camera
    valid: Box

    def downsampled(self, factor: int) -> ObjectCrop:
        """The same with pixels that are means of ``factor`` x ``factor``."""
        width, height = self.size
        return ObjectCrop(
            functional.avg_pool2d(self.image, factor),
            (width / factor, height / factor),
            self.zoom / factor,
            self.middle,
            downsampled(self.camera, factor),
            Box(*(side / factor for side in self.valid)),
        )

    def converted(self, pose: Tensor, other: ObjectCrop) -> Tensor:
        """A pose (6,) for this crop as one for another of the same photograph, whose lens has the same focal length."""
        moved = pose.clone()
        for axis in (0, 1):
            place = pose[4 + axis] / self.zoom + self.middle[axis]
            moved[4 + axis] = (place - other.middle[axis]) * other.zoom
        return moved

    @property
    def centred_box(self) -> Box:
        """The object's, from the middle of the crop, pixels."""
        width, height = self.size
        return Box(-width / 2, -height / 2, width / 2, height / 2)

    @property
    def focal(self) -> float:
        """Focal length of the photograph's camera, pixels of the photograph."""
        return self.camera.focal / self.zoom

    def in_photograph(self, pose: Tensor, height: int, width: int) -> tuple[Tensor, Camera]:
        """A pose (6,) for this crop as one for the whole photograph of ``height`` x ``width``, with its camera."""
        moved = pose.clone()
        x, y = self.middle
        moved[4] = pose[4] / self.zoom + x - width / 2
        moved[5] = pose[5] / self.zoom + y - height / 2
        return moved, Camera(self.camera.focal / self.zoom, height, width)


def typical_camera(side: int = SIDE, fill: float = FILL) -> Camera:
    """The camera that sees an object at :data:`DISTANCE` fill ``fill`` of ``side`` pixels."""
    return Camera(DISTANCE * fill / _TYPICAL_EXTENT, side, side)


def downsampled(camera: Camera, factor: int) -> Camera:
    """A camera that sees the same in pixels ``factor`` times as large."""
    return Camera(camera.focal / factor, camera.height // factor, camera.width // factor)


def checked_box(sides: Sequence[float], height: int, width: int) -> Box:
    """The box x0, y0, x1, y1.

    Raises:
        ValueError: it is not finite, has fewer than 8 pixels a side, or lies beside an image of this size.
    """
    box = Box.of(sides)
    if not all(map(math.isfinite, box)) or not (box.width >= 8 and box.height >= 8):
        raise ValueError(f"the box must be x0, y0, x1, y1 with sides of at least 8 pixels, got {tuple(box)}")
    if box.x1 <= 0 or box.y1 <= 0 or box.x0 >= width or box.y0 >= height:
        raise ValueError(f"the box must lie in the image of {height}x{width} pixels (height x width), got {tuple(box)}")
    return box


def crop_object(
    photograph: Tensor,
    box: Sequence[float] | None = None,
    side: int = SIDE,
    fill: float = FILL,
    focal: float | None = None,
) -> ObjectCrop:
    """The square of ``side`` pixels around a box, shrunk or enlarged so that the box's longer side has ``fill``.

    Args:
        photograph: (C, H, W), float32 or float64 in 0…1, one channel or R, G, B.
        box: x0, y0, x1, y1 of the object, pixels; by default the whole photograph.
        side: of the crop, pixels.
        fill: of the box's longer side, pixels.
        focal: focal length of the photograph's camera, pixels; by default such that an object that fills the box is
            seen from :data:`DISTANCE`.

    Raises:
        ValueError: the photograph is of another shape, holds NaN, or the box is empty or beside it.
    """
    check_photograph(photograph)
    height, width = photograph.shape[1:]
    object_box = checked_box((0, 0, width, height) if box is None else box, height, width)
    zoom = fill / max(object_box.width, object_box.height)
    middle = (object_box.x0 + object_box.x1) / 2, (object_box.y0 + object_box.y1) / 2
    size = object_box.width * zoom, object_box.height * zoom
    (x0, x1), (y0, y1) = (
        (zoom * (0 - at) + side / 2, zoom * (length - at) + side / 2)
        for at, length in zip(middle, (width, height), strict=True)
    )
    camera = typical_camera(side, fill) if focal is None else Camera(focal * zoom, side, side)
    return ObjectCrop(resampled(photograph, middle, zoom, side), size, zoom, middle, camera, Box(x0, y0, x1, y1))


def check_photograph(photograph: Tensor) -> None:
    """Raises ValueError unless it is a finite floating point tensor (1 or 3, H, W)."""
    if photograph.dim() != 3 or photograph.shape[0] not in (1, 3) or not photograph.is_floating_point():
        raise ValueError(
            f"the photograph must be a floating point tensor (1 or 3, H, W), "
            f"got {photograph.dtype} of shape {tuple(photograph.shape)}"
        )
    # the sum of finite numbers is hardly ever infinite, and takes a tenth of the time
    if not math.isfinite(photograph.sum()) and not torch.isfinite(photograph).all():
        raise ValueError("the photograph must be finite, got NaN or Inf")


def resampled(photograph: Tensor, middle: tuple[float, float], zoom: float, side: int) -> Tensor:
    """The square (1, 1, side, side) around ``middle``, gray, without aliasing; the photograph's border repeats."""
    height, width = photograph.shape[1:]
    sigma = 0.5 * math.sqrt(max(0.0, 1 / zoom**2 - 1))
    reach = math.ceil(side / zoom / 2 + 3 * sigma) + 2
    left, top = math.floor(middle[0]) - reach, math.floor(middle[1]) - reach
    rows = torch.arange(top, top + 2 * reach + 1).clamp(0, height - 1)
    cols = torch.arange(left, left + 2 * reach + 1).clamp(0, width - 1)
    part = gray(photograph[:, rows][:, :, cols][None].float())
    if sigma > 0:
        part = blurred(part, sigma)
    at = (torch.arange(side) + 0.5 - side / 2) / zoom
    x, y = ((at + m - start) / (2 * reach + 1) * 2 - 1 for m, start in zip(middle, (left, top), strict=True))
    grid = torch.stack(torch.meshgrid(y, x, indexing="ij")[::-1], dim=-1)[None].float()
    image = functional.grid_sample(part, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return image.clamp(0, 1)


def blurred(image: Tensor, sigma: float) -> Tensor:
    """An image (1, 1, H, W) blurred by a Gaussian of ``sigma`` > 0 pixels; its border repeats."""
    reach = max(1, math.ceil(3 * sigma))
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / sigma) ** 2)
    taps = taps / taps.sum()
    padded = functional.pad(image, (reach,) * 4, mode="replicate")
    return functional.conv2d(functional.conv2d(padded, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))
