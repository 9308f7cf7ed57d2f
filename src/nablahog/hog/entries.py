"""What a descriptor has of each cell's histogram, and where its cells are: the way back begins here."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import fold

from .normalizers import BlockNorm, FourBlockNorm
from .pooling import pooling_matrices
from .poolings import BilinearCells, BlockCells
from .spec import HOGSpec


def cell_entries(descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) to what they have of histograms: (B, bins, rows, cols) of cells.

    Entries are clipped, off by the level of their cell or its neighbourhood, and the mean of all that the descriptor
    has of them: over blocks, and over colours.  Of signed bins these are the directed entries, or for want of them
    each undirected one twice.  Cells that the normaliser drops are not there.
    """
    target = descriptor.permute(0, 3, 1, 2)
    batch, _, rows, cols = target.shape
    if spec.colours > 1:
        target = target.reshape(batch, spec.colours, -1, rows, cols).mean(dim=1)
    if isinstance(spec.normalizer, BlockNorm):
        return _mean_over_blocks(target, spec, spec.normalizer)
    return _of_four_blocks(target, spec, spec.normalizer) if isinstance(spec.normalizer, FourBlockNorm) else target


def _of_four_blocks(target: Tensor, spec: HOGSpec, scheme: FourBlockNorm) -> Tensor:
    if "directed" in scheme.parts:
        return target[:, : spec.bins]
    half = spec.bins // 2 if spec.signed else spec.bins
    if "undirected" in scheme.parts:
        undirected = target[:, :half]
    else:  # these are the blocks
        first = 4 * ("texture" in scheme.parts)
        undirected = target[:, first : first + 4 * half].reshape(len(target), 4, half, *target.shape[2:]).mean(dim=1)
    return torch.cat([undirected, undirected], dim=1) if spec.signed else undirected


def _mean_over_blocks(target: Tensor, spec: HOGSpec, scheme: BlockNorm) -> Tensor:
    batch, _, rows, cols = target.shape
    (high, wide), step = scheme.block, scheme.step
    size = ((rows - 1) * step[0] + high, (cols - 1) * step[1] + wide)
    if scheme.form == "L1-sqrt":
        target = target.square()
    blocks = target.reshape(batch, high * wide, spec.bins, rows * cols).transpose(1, 2).flatten(1, 2)
    ones = torch.ones_like(blocks[:1, : high * wide])
    counts = fold(ones, size, scheme.block, stride=step).clamp(min=1)  # of cells between blocks 0
    return fold(blocks, size, scheme.block, stride=step) / counts


class CellAlignment:
    """Cells side by side in the image, of votes that all their pixels cast with a weight of 1 in the sum.

    The same as the dialect's own cells where these share votes bilinearly.  Boxes may have means instead of sums;
    and where each block has cells of its own (:class:`.poolings.BlockCells`), those that lie on each other are one.

    Args:
        spec: the dialect.
        size: (height, width) of the image.
        like: a tensor whose dtype and device to use.
    """

    def __init__(self, spec: HOGSpec, size: tuple[int, int], like: Tensor) -> None:
        self.same, self.blocks = isinstance(spec.pooling, BilinearCells), isinstance(spec.pooling, BlockCells)
        if self.same:
            return
        by_row, by_col = pooling_matrices(spec, *size, like)
        # how much of its pixels' votes a cell gets
        self.weights = torch.outer(by_row.sum(dim=1), by_col.sum(dim=1)) / (spec.cell_size[0] * spec.cell_size[1])
        if isinstance(spec.pooling, BlockCells):
            self.rows, self.cols = (_places(spec, spec.pooling, axis, size[axis], like) for axis in (0, 1))
            self.shape = int(self.rows.max()) + 1, int(self.cols.max()) + 1

    def __call__(self, histograms: Tensor) -> Tensor:
        """From the dialect's cells (B, bins, rows, cols), the mean of those that are one."""
        if self.same:
            return histograms
        alike = histograms / self.weights
        if not self.blocks:
            return alike
        return self._summed(alike) / self._summed(torch.ones_like(alike[:1, :1])).clamp(min=1)

    def restore(self, histograms: Tensor) -> Tensor:
        """To the dialect's cells."""
        if self.same:
            return histograms
        return (histograms[:, :, self.rows][..., self.cols] if self.blocks else histograms) * self.weights

    def _summed(self, of_blocks: Tensor) -> Tensor:
        batch, bins, _, cols = of_blocks.shape
        rows = of_blocks.new_zeros(batch, bins, self.shape[0], cols).index_add(2, self.rows, of_blocks)
        return rows.new_zeros(batch, bins, *self.shape).index_add(3, self.cols, rows)


def _places(spec: HOGSpec, pooling: BlockCells, axis: int, pixels: int, like: Tensor) -> Tensor:
    """Of the cells of all blocks along an axis, which of the cells side by side each is; the nearest if between two."""
    block, step, cell = pooling.block[axis], pooling.step[axis], spec.cell_size[axis]
    firsts = torch.arange((pixels - block) // step + 1, device=like.device) * step
    inside = torch.arange(block // cell, device=like.device)
    return (torch.round(firsts / cell).long().unsqueeze(1) + inside).flatten()
