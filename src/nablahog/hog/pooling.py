"""Eq. 5-6: from votes to cell histograms, as one matrix for the rows and one for the columns."""

from __future__ import annotations

import torch
from torch import Tensor

from .spec import HOGSpec


def pooling_matrix(pixels: int, cell: int, cells: int, ignore_ring: bool, like: Tensor) -> Tensor:
    """Weights (cells, pixels) of pixels in cells along one axis, dtype and device of ``like``.

    Row k is the bilinear filter f^s of Eq. 5 along that axis, placed at the centre of cell k (Eq. 6):
    1 - |distance to the centre| / cell, at least 0.  Two neighbouring cells share each pixel between their centres.

    Args:
        pixels: pixels along the axis.
        cell: pixels of a cell along the axis.
        cells: number of cells.
        ignore_ring: the first and the last pixel cast no vote.
        like: tensor whose dtype and device to use.
    """
    centres = (torch.arange(pixels, dtype=like.dtype, device=like.device) + 0.5) / cell - 0.5
    matrix = 1 - (centres - torch.arange(cells, dtype=like.dtype, device=like.device).unsqueeze(1)).abs()
    matrix = matrix.clamp(min=0)
    if ignore_ring:
        inner = torch.arange(pixels, device=like.device)
        matrix = matrix * ((inner > 0) & (inner < pixels - 1))
    return matrix


def pool(votes: Tensor, spec: HOGSpec) -> Tensor:
    """F^s of Eq. 5-6: votes (B, bins, H, W) to cell histograms (B, bins, rows, cols).  Linear."""
    height, width = votes.shape[-2:]
    rows, cols = spec.grid(height, width)
    ring = spec.border == "ignore"
    by_row = pooling_matrix(height, spec.cell_size[0], rows, ring, votes)
    by_col = pooling_matrix(width, spec.cell_size[1], cols, ring, votes)
    return by_row @ (votes @ by_col.T)
