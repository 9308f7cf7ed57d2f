"""The entries of each cell's histogram in a descriptor, and where its cells are: the first step of an inversion."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from .spec import HOGSpec
from .steps import pooling_axes


def mean_over_colours(planes: Tensor, spec: HOGSpec) -> Tensor:
    """Histograms, or channels, (B, colours · n, rows, cols) to (B, n, rows, cols)."""
    if spec.colours == 1:
        return planes
    return planes.reshape(len(planes), spec.colours, -1, *planes.shape[2:]).mean(dim=1)


def cell_entries(descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """The normalised histograms in descriptors (B, rows, cols, channels): (B, bins, rows, cols) of cells.

    An entry is the mean over all channels that hold it: over blocks, and over colours.  It is clipped, and divided by
    the energy of its cell or neighbourhood.  For signed bins these are directed entries; if the descriptor has none,
    each undirected entry twice.  Cells that the normaliser leaves out are missing.
    """
    return spec.normalizer.cell_entries(mean_over_colours(descriptor.permute(0, 3, 1, 2), spec), spec.bins, spec.signed)


def with_margin(cells: Tensor, spec: HOGSpec) -> Tensor:
    """Pads entries (B, n, rows, cols) with 0 for the cells around them that the normaliser leaves out."""
    rows, cols = (spec.normalizer.footprint(axis).margin for axis in (0, 1))
    return pad(cells, (cols, cols, rows, rows))


def covered_cells(spec: HOGSpec, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Which rows (rows,) and columns (cols,) of the cells of an image (height, width) are described."""
    rows, cols = (
        torch.tensor(spec.normalizer.footprint(axis).covers(cells), device="cpu")
        for axis, cells in enumerate(spec.cells(*size))
    )
    return rows, cols


def fill_from_nearest(entries: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Entries (B, n, …) of :func:`cell_entries` for all cells of an image: missing ones are the nearest cell's."""
    for axis, covered in enumerate(covered_cells(spec, size)):
        described, cells = covered.nonzero().squeeze(1), torch.arange(len(covered), device="cpu")
        nearest = (
            described[(cells.unsqueeze(1) - described).abs().argmin(dim=1)] - spec.normalizer.footprint(axis).margin
        )
        entries = entries.index_select(2 + axis, nearest.to(entries.device))
    return entries


class CellAlignment:
    """From a dialect's cells to cells that tile the image, each the sum of its pixels' votes, and the inverse.

    Bilinear cells are such cells.  Boxes may hold means, or weighted sums.  Where each block has cells of its own
    (:class:`.poolings.BlockCells`), cells of several blocks at one place become one, their mean.

    Args:
        spec: the dialect.
        size: (height, width) of the image.
        like: a tensor whose dtype and device to use.
    """

    def __init__(self, spec: HOGSpec, size: tuple[int, int], like: Tensor) -> None:
        pooling = spec.pooling
        self.is_tiling, self.blocks = pooling.interpolates, pooling.has_blocks
        if self.is_tiling:
            return
        axes = pooling_axes(spec, *size, like)
        # mean weight of its pixels' votes
        self.weights = torch.outer(*(along.totals() for along in axes)) / (spec.cell_size[0] * spec.cell_size[1])
        if self.blocks:
            self.rows, self.cols = (
                torch.tensor(pooling.places(along.cells, spec.cell_size[axis], axis), device=like.device)
                for axis, along in enumerate(axes)
            )
            self.shape = int(self.rows.max()) + 1, int(self.cols.max()) + 1

    def __call__(self, histograms: Tensor) -> Tensor:
        """The dialect's cells (B, bins, rows, cols) to tiling cells."""
        if self.is_tiling:
            return histograms
        has_votes = self.weights > 0  # a cell in a ring that casts no votes has none
        tiling_cells = torch.where(has_votes, histograms / torch.where(has_votes, self.weights, 1), 0)
        if not self.blocks:
            return tiling_cells
        return self._summed(tiling_cells) / self._summed(torch.ones_like(tiling_cells[:1, :1])).clamp(min=1)

    def restore(self, histograms: Tensor) -> Tensor:
        """Tiling cells to the dialect's cells."""
        if self.is_tiling:
            return histograms
        return (histograms[:, :, self.rows][..., self.cols] if self.blocks else histograms) * self.weights

    def _summed(self, block_cells: Tensor) -> Tensor:
        batch, bins, _, cols = block_cells.shape
        rows = block_cells.new_zeros(batch, bins, self.shape[0], cols).index_add(2, self.rows, block_cells)
        return rows.new_zeros(batch, bins, *self.shape).index_add(3, self.cols, rows)
