"""Each pixel votes into its own cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..checks import LONGEST_SIDE, shortened
from .base import Pooling

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class BoxCells(Pooling):
    """Each pixel votes into its own cell.

    Attributes:
        mean: whether a histogram is the mean over its pixels, not their sum.
        window: pixels of the side of a Gaussian window, of sum 1, that is tiled over the image and weighs its votes;
            its standard deviation is half of that.  0 for none.
    """

    mean: bool = False
    window: int = 0
    kind: ClassVar[str] = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        if type(self.window) is not int or self.window == 1 or not 0 <= self.window <= LONGEST_SIDE:
            raise ValueError(
                f"window must be 0 or a number of pixels in 2 … {LONGEST_SIDE:,}, got {shortened(self.window)}"
            )

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """1 in a pixel's own cell, or what the window and the mean make of it."""
        import torch

        pixel = torch.arange(pixels, device=like.device)
        weights = torch.ones(pixels, dtype=like.dtype, device=like.device)
        if self.mean:
            weights = weights / cell
        if self.window:
            side = torch.arange(self.window, dtype=like.dtype, device=like.device)
            window = torch.exp(-0.5 * ((side - side.mean()) / (self.window // 2)) ** 2)
            weights = weights * (window / window.sum())[pixel % self.window]
        # a row after the last cell for the pixels that are in none
        matrix = torch.zeros(cells + 1, pixels, dtype=like.dtype, device=like.device)
        own = torch.div(pixel, cell, rounding_mode="floor").clamp(max=cells)
        matrix = matrix.scatter_(0, own.unsqueeze(0), weights.unsqueeze(0))[:-1]
        if ring:
            matrix[:, [0, -1]] = 0
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        """Its own pixels."""
        return 0, cell

    @property
    def tile(self) -> int:
        """That of the window."""
        return self.window or 1
