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


def distort(x: Tensor, y: Tensor, distortion: tuple[float, ...]) -> tuple[Tensor, Tensor]:
    """Where a lens with OpenCV's k1, k2, p1, p2, k3 moves points x, y of depth 1."""
    k1, k2, p1, p2, k3 = distortion
    r2, xy = x * x + y * y, 2 * x * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return x * radial + p1 * xy + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + p2 * xy


def undistort(x: Tensor, y: Tensor, distortion: tuple[float, ...]) -> tuple[Tensor, Tensor]:
    """The points that :func:`distort` moves to x, y, by Newton's method; NaN where it finds none."""
    found_x, found_y = x, y
    for _ in range(_STEPS):
        xx, xy, yy = distortion_jacobian(found_x, found_y, distortion)
        off_x, off_y = _subtract((x, y), distort(found_x, found_y, distortion))
        det = xx * yy - xy * xy
        found_x, found_y = found_x + (yy * off_x - xy * off_y) / det, found_y + (xx * off_y - xy * off_x) / det
    off_x, off_y = _subtract((x, y), distort(found_x, found_y, distortion))
    is_found = torch.maximum(off_x.abs(), off_y.abs()) < _EXACT
    return torch.where(is_found, found_x, torch.nan), torch.where(is_found, found_y, torch.nan)


def _subtract(one: tuple[Tensor, Tensor], other: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return one[0] - other[0], one[1] - other[1]


def distortion_jacobian(x: Tensor, y: Tensor, distortion: tuple[float, ...]) -> tuple[Tensor, Tensor, Tensor]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x and ∂y'/∂y of :func:`distort`."""
    k1, k2, p1, p2, k3 = distortion
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
        if not bool(torch.isfinite(torch.stack(self._border)).all()) or not self._is_unfolded():
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
        x, y = self._border
        (x0, x1), (y0, y1) = ((float(line.min()), float(line.max())) for line in (x, y))
        more_x, more_y = round(MOST_BEYOND * self.width), round(MOST_BEYOND * self.height)
        return Box(
            max(-more_x, math.floor(x0)),
            max(-more_y, math.floor(y0)),
            min(self.width + more_x, math.ceil(x1)),
            min(self.height + more_y, math.ceil(y1)),
        )

    def from_photograph(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Points of the photograph in the ideal image, pixels."""
        real = self.real
        ray_x, ray_y = undistort((x - real.cx) / real.fx, (y - real.cy) / real.fy, real.distortion)
        return ray_x * self.focal + self.axis[0], ray_y * self.focal + self.axis[1]

    def to_photograph(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Points of the ideal image in the photograph, pixels."""
        real = self.real
        ray_x, ray_y = distort((x - self.axis[0]) / self.focal, (y - self.axis[1]) / self.focal, real.distortion)
        return ray_x * real.fx + real.cx, ray_y * real.fy + real.cy

    def map_box(self, box: Box) -> Box:
        """A box of the photograph in the ideal image: through the middles of its sides."""
        return _box_through(*self.from_photograph(*_middles(box)))

    def map_box_back(self, box: Box) -> Box:
        """A box of the ideal image in the photograph: through the middles of its sides."""
        return _box_through(*self.to_photograph(*_middles(box)))

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
            place = self._limit(torch.arange(left, right) + 0.5, torch.arange(row, end)[:, None] + 0.5)
            x, y = self.to_photograph(*place)
            grid = torch.stack([x * (2 / self.real.width) - 1, y * (2 / self.real.height) - 1], dim=-1)
            strip = functional.grid_sample(
                values[None], grid[None].to(values), mode="bicubic", padding_mode="border", align_corners=False
            )
            picture[:, row - top : end - top] = strip[0].clamp(0, 1)
        return picture

    def _limit(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Points no further from the axis than the photograph's border, beyond which the distortion may fold."""
        across, down = x - self.axis[0], y - self.axis[1]
        border_x, border_y = self._border
        reach = float(torch.hypot(border_x - self.axis[0], border_y - self.axis[1]).max())
        share = (reach / torch.hypot(across, down)).clamp(max=1)
        return across * share + self.axis[0], down * share + self.axis[1]

    @cached_property
    def _border(self) -> tuple[Tensor, Tensor]:
        """Points x, y (N,) all around the photograph, in the ideal image."""
        along = torch.linspace(0, 1, _BORDER_POINTS, dtype=torch.float64)
        zero, one = torch.zeros_like(along), torch.ones_like(along)
        x, y = torch.cat([along, along, zero, one]), torch.cat([zero, one, along, along])
        return self.from_photograph(x * self.real.width, y * self.real.height)

    def _is_unfolded(self) -> bool:
        """Whether neighbours remain neighbours on all rays to the border."""
        shares = torch.linspace(0, 1, 64, dtype=torch.float64)[:, None] / self.focal
        x, y = (shares * (line - middle) for line, middle in zip(self._border, self.axis, strict=True))
        xx, xy, yy = distortion_jacobian(x, y, self.real.distortion)
        return bool((xx * yy - xy * xy > 0).all()) and bool((xx + yy > 0).all())


def _middles(box: Box) -> tuple[Tensor, Tensor]:
    """x and y (4,) of the middles of the left, right, upper and lower side."""
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    points = torch.tensor([[box.x0, box.x1, x, x], [y, y, box.y0, box.y1]], dtype=torch.float64)
    return points[0], points[1]


def _box_through(x: Tensor, y: Tensor) -> Box:
    return Box(float(x[0]), float(y[2]), float(x[1]), float(y[3]))
