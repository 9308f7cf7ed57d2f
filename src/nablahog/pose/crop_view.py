"""From a photograph's pixels to a crop's: where each is in the other, and their gray values without aliasing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from ..hog.gradient import gray
from ..inputs.boxes import Box
from ..render.conventions import turn_to

MOST_OVERSAMPLING = 8  # or means of pixels, of a photograph along a side of a crop's pixel: the blur would hide more
STRIP_PIXELS = 2**20  # pixels that are averaged or blurred at once
_LEAST_DEPTH = 1e-3  # of rays, to divide by; it is 1 on the optical axis


@dataclass(frozen=True, eq=False)
class CropView:
    """The map from a crop's pixels to its photograph's."""

    middle: tuple[float, float]  # x, y of the crop's middle in the photograph, pixels
    zoom: float  # pixels of the crop for one of the photograph, in its middle
    focal: float  # of the photograph's camera, pixels
    axis: tuple[float, float] | None  # x, y of the optical axis in the photograph; None if unknown

    @cached_property
    def turn(self) -> Tensor:
        """(3, 3): from the frame of the photograph's camera to that of one that looks at the crop's middle."""
        return turn_to(self._ray(*self.middle))

    def to_photograph(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """x and y in the photograph of points that are x and y from the middle of the crop, pixels."""
        if self.axis is None:
            return x / self.zoom + self.middle[0], y / self.zoom + self.middle[1]
        scale = self.zoom * self.focal
        ones = torch.ones_like(x + y)
        rays = torch.stack([x / scale * ones, y / scale * ones, ones], -1).double() @ self.turn
        along = rays[..., :2] * (self.focal / rays[..., 2:].clamp(min=_LEAST_DEPTH))
        return (along[..., 0] + self.axis[0]).to(x), (along[..., 1] + self.axis[1]).to(x)

    def from_photograph(self, x: float, y: float) -> tuple[float, float]:
        """x and y from the middle of the crop of a point of the photograph, pixels."""
        if self.axis is None:
            return (x - self.middle[0]) * self.zoom, (y - self.middle[1]) * self.zoom
        right, down, forward = (self.turn @ self._ray(x, y)).tolist()
        scale = self.zoom * self.focal / max(forward, _LEAST_DEPTH)
        return right * scale, down * scale

    def map_box(self, box: Box) -> Box:
        """A photograph's box in the crop, pixels from its middle; its sides are those on lines through the middle."""
        x, y = self.middle
        left, right = (self.from_photograph(side, y)[0] for side in (box.x0, box.x1))
        upper, lower = (self.from_photograph(x, side)[1] for side in (box.y0, box.y1))
        return Box(left, upper, right, lower)

    def twist(self, x: float, y: float) -> float:
        """Degrees by which theta is larger in the photograph than in the crop, for an object x, y from its middle.

        Turning the camera to the object directly, or to the crop's middle first, differs by a rotation of the image.
        """
        if self.axis is None:
            return 0.0
        scale = self.zoom * self.focal
        there = turn_to(torch.tensor([x / scale, y / scale, 1.0], dtype=torch.float64)) @ self.turn
        at_once = turn_to(there[2]) @ there.T
        return math.degrees(math.atan2(float(at_once[0, 1]), float(at_once[0, 0])))

    def _ray(self, x: float, y: float) -> Tensor:
        """(3,), float64: the ray of a point of the photograph in its camera's frame, of depth 1."""
        assert self.axis is not None
        ray = [(x - self.axis[0]) / self.focal, (y - self.axis[1]) / self.focal, 1.0]
        return torch.tensor(ray, dtype=torch.float64)


def resample(photograph: Tensor, view: CropView, side: int) -> Tensor:
    """The square (1, 1, side, side) that a view shows, gray, without aliasing; the photograph's border repeats."""
    factor = reduction_factor(view.zoom)
    if factor > 1:
        photograph = gray_means(photograph, factor)
    height, width = photograph.shape[1:]
    # the remaining variance, in pixels of the means; a square of pixels has (factor² - 1) / 12
    sigma = math.sqrt(max(0.0, (1 / view.zoom**2 - 1) / 4 - (factor**2 - 1) / 12)) / factor
    at = torch.arange(side, dtype=torch.float32) + 0.5 - side / 2
    x, y = (coordinates / factor for coordinates in view.to_photograph(at[None, :], at[:, None]))
    middle = [coordinate / factor for coordinate in view.middle]
    if view.axis is None:
        reach = side / view.zoom / factor / 2
    else:  # beyond the border nothing changes
        x, y = x.clamp(-3 * sigma, width + 3 * sigma), y.clamp(-3 * sigma, height + 3 * sigma)
        reach = max(float((coordinates - m).abs().max()) for coordinates, m in zip((x, y), middle, strict=True))
    around = math.ceil(reach + 3 * sigma) + 2
    left, top = (math.floor(m) - around for m in middle)
    rows = torch.arange(top, top + 2 * around + 1).clamp(0, height - 1)
    cols = torch.arange(left, left + 2 * around + 1).clamp(0, width - 1)
    part = gray(_to_floats(photograph[:, rows][:, :, cols])[None])
    if sigma > 0:
        part = blur(part, sigma)
    across, down = ((coordinates - start) / (2 * around + 1) * 2 - 1 for coordinates, start in ((x, left), (y, top)))
    grid = torch.stack([across.expand(side, side), down.expand(side, side)], dim=-1)[None].float()
    image = functional.grid_sample(part, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return image.clamp(0, 1)


def reduction_factor(zoom: float) -> int:
    """The side of the squares of a photograph's pixels whose means are enough at a zoom; 1 for zooms above 1/16."""
    return max(1, int(1 / (MOST_OVERSAMPLING * zoom)))


def gray_means(photograph: Tensor, factor: int) -> Tensor:
    """The means of ``factor`` x ``factor`` pixels of a photograph (C, H, W), gray, (1, h, w), float32.

    The border repeats.  Strips are averaged one by one, which takes hardly more memory than the result.
    """
    channels, height, width = photograph.shape
    means = torch.empty(channels, -(-height // factor), -(-width // factor), dtype=torch.float32)
    rows = max(1, STRIP_PIXELS // (factor * width))  # of means at a time
    for row in range(0, len(means[0]), rows):
        strip = photograph[:, row * factor : (row + rows) * factor]
        beyond = (0, -width % factor, 0, -strip.shape[1] % factor)
        padded = functional.pad(_to_floats(strip)[None], beyond, mode="replicate")
        means[:, row : row + rows] = functional.avg_pool2d(padded, factor)[0]
    return gray(means[None])[0]


def _to_floats(photograph: Tensor) -> Tensor:
    return photograph.float() / 255 if photograph.dtype == torch.uint8 else photograph.float()


def blur(image: Tensor, sigma: float) -> Tensor:
    """An image (1, 1, H, W) blurred by a Gaussian of ``sigma`` > 0 pixels; its border repeats."""
    reach = max(1, math.ceil(3 * sigma))
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype) / sigma) ** 2)
    taps = taps / taps.sum()
    padded = functional.pad(image, (reach,) * 4, mode="replicate")
    result, rows = torch.empty_like(image), max(1, STRIP_PIXELS // image.shape[3])
    for row in range(0, image.shape[2], rows):  # a strip at a time
        strip = padded[:, :, row : row + rows + 2 * reach]
        across = functional.conv2d(strip, taps.view(1, 1, 1, -1))
        result[:, :, row : row + rows] = functional.conv2d(across, taps.view(1, 1, -1, 1))
    return result
