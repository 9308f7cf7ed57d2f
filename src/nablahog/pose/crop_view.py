"""Where the pixels of a crop are in its photograph.

Nothing is known of most cameras; their crops are cut out as they are.  A camera whose focal length and principal point
are known is turned in place until it looks at the middle of the crop.  Beside the optical axis a photograph stretches
objects; such a crop shows them as they are rendered, by a camera that looks straight at them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from ..render.rigid import turn_to

_BEHIND = 1e-3  # depth that rays have at least, of length 1 where they meet the image plane


@dataclass(frozen=True)
class CropView:
    """The map from a crop's pixels to its photograph's.

    Attributes:
        middle: x, y of the crop's middle in the photograph, pixels.
        zoom: pixels of the crop for one of the photograph, in its middle.
        focal: of the photograph's camera, pixels.
        axis: x, y where the optical axis meets the photograph, pixels; None if that, or the focal length, is unknown.
    """

    middle: tuple[float, float]
    zoom: float
    focal: float
    axis: tuple[float, float] | None = None

    @cached_property
    def turn(self) -> Tensor:
        """(3, 3): from the frame of the photograph's camera to that of one that looks at the crop's middle."""
        return turn_to(self._ray(*self.middle))

    def to_photograph(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """x and y in the photograph of points that are x and y from the middle of the crop, pixels."""
        if self.axis is None:
            return x / self.zoom + self.middle[0], y / self.zoom + self.middle[1]
        scale = self.zoom * self.focal
        one = torch.ones_like(x + y)
        rays = torch.stack([x / scale * one, y / scale * one, one], -1).double() @ self.turn
        along = rays[..., :2] * (self.focal / rays[..., 2:].clamp(min=_BEHIND))
        return (along[..., 0] + self.axis[0]).to(x), (along[..., 1] + self.axis[1]).to(x)

    def from_photograph(self, x: float, y: float) -> tuple[float, float]:
        """x and y from the middle of the crop of a point of the photograph, pixels."""
        if self.axis is None:
            return (x - self.middle[0]) * self.zoom, (y - self.middle[1]) * self.zoom
        right, down, forward = (self.turn @ self._ray(x, y)).tolist()
        scale = self.zoom * self.focal / max(forward, _BEHIND)
        return right * scale, down * scale

    def twist(self, x: float, y: float) -> float:
        """Degrees by which theta is larger in the photograph than in the crop, for an object x, y from its middle.

        The camera may be turned to the object at once, or to the crop's middle first: the image is turned, too.
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
