"""Real cameras and the ideal one: OpenCV's distortion, and a photograph as it would be without it.

Points are projected to x = X/Z, y = Y/Z; the lens moves them, with r² = x² + y², to

    x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²),
    y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y,

and the pixel is at (fx x + cx, fy y + cy).  The ideal camera has square pixels, the principal point of the real one, no
distortion, and the larger of its two focal lengths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from ..inputs.boxes import Box
from ..inputs.cameras import PhotographCamera

STRIP_PIXELS = 2**20  # pixels that are resampled at once
MOST_BEYOND = 0.5  # most that the whole ideal picture reaches beyond the ideal camera's own, in sides of that
_BORDER_POINTS = 256  # along a side
_STEPS, _EXACT = 50, 1e-10  # of Newton's method; focal lengths


def distort(points: Tensor, distortion: tuple[float, ...]) -> Tensor:
    """Where a lens with OpenCV's k1, k2, p1, p2, k3 moves points x, y (…, 2) of depth 1."""
    k1, k2, p1, p2, k3 = distortion
    x, y = points.unbind(-1)
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    moved_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    return torch.stack([moved_x, y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], dim=-1)


def undistort(points: Tensor, distortion: tuple[float, ...]) -> Tensor:
    """The points (…, 2) that :func:`distort` moves to ``points``, by Newton's method; NaN where it finds none."""
    found = points
    for _ in range(_STEPS):
        xx, xy, yy = distortion_jacobian(found, distortion)
        (x, y), det = (points - distort(found, distortion)).unbind(-1), xx * yy - xy * xy
        step = torch.stack([yy * x - xy * y, xx * y - xy * x], dim=-1) / det[..., None]
        found = found + step
    left = (distort(found, distortion) - points).abs().amax(-1, keepdim=True)
    return torch.where(left < _EXACT, found, torch.nan)


def distortion_jacobian(points: Tensor, distortion: tuple[float, ...]) -> tuple[Tensor, Tensor, Tensor]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x and ∂y'/∂y of :func:`distort` at points (…, 2)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = points.unbind(-1)
    r2 = x * x + y * y
    radial, slope = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    across = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, across, radial + y * y * slope + 6 * p1 * y + 2 * p2 * x


@dataclass(frozen=True, eq=False)
class IdealCamera:
    """The camera without distortion and with square pixels that stands where a photograph's camera stood.

    Attributes:
        real: the camera that took the photograph.
        focal: of the ideal one, pixels.
        height, width: of the part of its image plane that is as large as the photograph, pixels.
        axis: x, y of the principal point there.

    Raises:
        ValueError: the real camera's distortion folds the photograph, so that it cannot be undone.
    """

    real: PhotographCamera

    def __post_init__(self) -> None:
        if not bool(torch.isfinite(self._border).all()) or not self._is_unfolded():
            raise ValueError(
                f"`distortion` must be such that it can be undone in all of the photograph's {self.real.height}x"
                f"{self.real.width} pixels, got {self.real.distortion}: are these OpenCV's k1, k2, p1, p2, k3, and "
                "the intrinsics those of a photograph of this size?"
            )

    @property
    def focal(self) -> float:
        return max(self.real.fx, self.real.fy)

    @property
    def height(self) -> int:
        return max(1, round(self.real.height * self.focal / self.real.fy))

    @property
    def width(self) -> int:
        return max(1, round(self.real.width * self.focal / self.real.fx))

    @property
    def axis(self) -> tuple[float, float]:
        return self.real.cx * self.focal / self.real.fx, self.real.cy * self.focal / self.real.fy

    @cached_property
    def whole(self) -> Box:
        """The box around all that the photograph shows, whole pixels, but not far beyond (0, 0, width, height)."""
        if not any(self.real.distortion):
            return Box(0, 0, self.width, self.height)
        (x0, y0), (x1, y1) = (side.tolist() for side in (self._border.amin(0), self._border.amax(0)))
        more_x, more_y = round(MOST_BEYOND * self.width), round(MOST_BEYOND * self.height)
        return Box(
            max(-more_x, math.floor(x0)),
            max(-more_y, math.floor(y0)),
            min(self.width + more_x, math.ceil(x1)),
            min(self.height + more_y, math.ceil(y1)),
        )

    def from_photograph(self, points: Tensor) -> Tensor:
        """Points x, y (…, 2) of the photograph in the ideal image, pixels."""
        rays = (points.double() - self._real_axis) / self._real_focal
        return undistort(rays, self.real.distortion) * self.focal + self._axis

    def to_photograph(self, points: Tensor) -> Tensor:
        """Points x, y (…, 2) of the ideal image in the photograph, pixels."""
        rays = (points.double() - self._axis) / self.focal
        return distort(rays, self.real.distortion) * self._real_focal + self._real_axis

    def map_box(self, box: Box) -> Box:
        """A box of the photograph in the ideal image: through the middles of its sides."""
        return _box_through(self.from_photograph(_middles(box)))

    def map_box_back(self, box: Box) -> Box:
        """A box of the ideal image in the photograph: through the middles of its sides."""
        return _box_through(self.to_photograph(_middles(box)))

    def resample(self, photograph: Tensor, box: Box) -> Tensor:
        """What the ideal camera would see in a box of its image, whole pixels; beyond the photograph, its border.

        Args:
            photograph: (C, H, W), floating point in 0…1, or uint8.
            box: such as :attr:`whole`.

        Returns:
            (C, h, w) in 0…1, by bicubic interpolation; of bytes float32.
        """
        left, top, right, bottom = map(int, box)
        values = photograph if photograph.is_floating_point() else photograph.float() / 255
        picture = values.new_empty(len(values), bottom - top, right - left)
        rows = max(1, STRIP_PIXELS // (right - left))
        for row in range(top, bottom, rows):
            end = min(row + rows, bottom)
            y, x = torch.meshgrid(torch.arange(row, end) + 0.5, torch.arange(left, right) + 0.5, indexing="ij")
            grid = self.to_photograph(self._limit(torch.stack([x, y], dim=-1).double()))
            grid = grid / grid.new_tensor([self.real.width, self.real.height]) * 2 - 1
            strip = functional.grid_sample(
                values[None], grid[None].to(values), mode="bicubic", padding_mode="border", align_corners=False
            )
            picture[:, row - top : end - top] = strip[0].clamp(0, 1)
        return picture

    def _limit(self, points: Tensor) -> Tensor:
        """Points no further from the axis than the photograph's border, beyond which the distortion may fold."""
        off = points - self._axis
        reach = (self._border - self._axis).norm(dim=-1).max()
        return self._axis + off * torch.clamp(reach / off.norm(dim=-1, keepdim=True), max=1)

    @cached_property
    def _border(self) -> Tensor:
        """Points (N, 2) all around the photograph, in the ideal image."""
        along = torch.linspace(0, 1, _BORDER_POINTS, dtype=torch.float64)
        zero, one = torch.zeros_like(along), torch.ones_like(along)
        sides = [torch.stack(side, dim=-1) for side in ((along, zero), (along, one), (zero, along), (one, along))]
        return self.from_photograph(torch.cat(sides) * torch.tensor([self.real.width, self.real.height]))

    def _is_unfolded(self) -> bool:
        """Whether neighbours remain neighbours on all rays to the border."""
        rays = (self._border - self._axis) / self.focal
        xx, xy, yy = distortion_jacobian(torch.linspace(0, 1, 64)[:, None, None] * rays, self.real.distortion)
        return bool((xx * yy - xy * xy > 0).all()) and bool((xx + yy > 0).all())

    @cached_property
    def _axis(self) -> Tensor:
        return torch.tensor(self.axis, dtype=torch.float64)

    @cached_property
    def _real_axis(self) -> Tensor:
        return torch.tensor([self.real.cx, self.real.cy], dtype=torch.float64)

    @cached_property
    def _real_focal(self) -> Tensor:
        return torch.tensor([self.real.fx, self.real.fy], dtype=torch.float64)


def _middles(box: Box) -> Tensor:
    """(4, 2): the middles of the left, right, upper and lower side."""
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    return torch.tensor([[box.x0, y], [box.x1, y], [x, box.y0], [x, box.y1]], dtype=torch.float64)


def _box_through(middles: Tensor) -> Box:
    (x0, _), (x1, _), (_, y0), (_, y1) = middles.tolist()
    return Box(x0, y0, x1, y1)
