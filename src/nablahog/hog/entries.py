"""What a descriptor has of each cell's histogram, and where its cells are: the way back begins here."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from .pooling import pooling_matrices
from .spec import HOGSpec


def mean_over_colours(descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) to (B, channels of one colour, rows, cols)."""
    target = descriptor.permute(0, 3, 1, 2)
    if spec.colours > 1:
        target = target.reshape(len(target), spec.colours, -1, *target.shape[2:]).mean(dim=1)
    return target


def cell_entries(descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) to what they have of histograms: (B, bins, rows, cols) of cells.

    Entries are clipped, off by the level of their cell or its neighbourhood, and the mean of all that the descriptor
    has of them: over blocks, and over colours.  Of signed bins these are the directed entries, or for want of them
    each undirected one twice.  Cells that the normaliser leaves out are not there.
    """
    return spec.normalizer.cell_entries(mean_over_colours(descriptor, spec), spec.bins, spec.signed)


def with_margin(cells: Tensor, spec: HOGSpec, mode: str = "constant") -> Tensor:
    """Entries (B, n, rows, cols) of cells, with those around that the normaliser leaves out: 0, or ``"replicate"``."""
    rows, cols = (spec.normalizer.footprint(axis).margin for axis in (0, 1))
    return pad(cells, (cols, cols, rows, rows), mode=mode) if rows or cols else cells


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
        pooling = spec.pooling
        self.same, self.blocks = pooling.interpolates, pooling.has_blocks
        if self.same:
            return
        by_row, by_col = pooling_matrices(spec, *size, like)
        # how much of its pixels' votes a cell gets
        self.weights = torch.outer(by_row.sum(dim=1), by_col.sum(dim=1)) / (spec.cell_size[0] * spec.cell_size[1])
        if self.blocks:
            self.rows, self.cols = (
                torch.tensor(pooling.places(len(matrix), spec.cell_size[axis], axis), device=like.device)
                for axis, matrix in enumerate((by_row, by_col))
            )
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
