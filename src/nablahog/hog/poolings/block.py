"""Blocks of cells at a step in pixels, each with histograms of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..normalizers.base import Footprint
from .base import PartialCells, Pooling, Spacing
from .bilinear import triangles

if TYPE_CHECKING:
    from torch import Tensor

    from ..normalizers import Normalizer


@dataclass(frozen=True)
class BlockCells(Pooling):
    """Blocks of cells at a step in pixels, each with histograms of its own: votes do not leave their block (OpenCV).

    Attributes:
        block: (height, width) of a block in pixels, whole cells.
        step: (height, width) in pixels from one block to the next.
        sigma: standard deviation in pixels of the Gaussian that weighs a block's votes; its middle is the pixel
            of index side / 2.
    """

    block: tuple[int, int]
    step: tuple[int, int]
    sigma: float
    kind: ClassVar[str] = "block"
    has_blocks: ClassVar[bool] = True

    def check(self, cell_size: tuple[int, int], normalizer: Normalizer) -> None:
        """Blocks must be whole cells, and be those of the normaliser."""
        if any(b % c for b, c in zip(self.block, cell_size, strict=True)):
            raise ValueError(f"blocks of {self.block} pixels are no whole cells of {cell_size}")
        cells = self.block[0] // cell_size[0], self.block[1] // cell_size[1]
        blocks = [Footprint(step=n, extent=n) for n in cells]
        if [normalizer.footprint(axis) for axis in (0, 1)] != blocks or normalizer.reach() != 0:
            raise ValueError(f"votes within blocks go with a BlockNorm of block and step {cells}")

    def spacing(self, cell: int, axis: int) -> Spacing:
        """Those of a block at each step."""
        return Spacing(self.step[axis], self.block[axis] // cell)

    def cells(self, pixels: int, cell: int, axis: int, partial: PartialCells) -> int:
        """Those of all blocks that fit in."""
        blocks = (pixels - self.block[axis]) // self.step[axis] + 1
        return blocks * (self.block[axis] // cell)

    def smallest(self, cell_size: tuple[int, int]) -> tuple[str, tuple[int, int]]:
        """A block."""
        return "block", self.block

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """Of each block in turn its cells, by rows."""
        import torch

        block, step = self.block[axis], self.step[axis]
        inside = torch.arange(block, dtype=like.dtype, device=like.device)
        weights = triangles(block, cell, block // cell, like)
        weights = weights * torch.exp(-((inside - block / 2) ** 2) / (2 * self.sigma**2))
        matrix = like.new_zeros((pixels - block) // step + 1, block // cell, pixels)
        for k, of_block in enumerate(matrix):
            of_block[:, k * step : k * step + block] = weights
        matrix = matrix.flatten(0, 1)
        if ring:
            matrix[:, [0, -1]] = 0
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        """The pixels of the block."""
        return 0, self.block[axis]
