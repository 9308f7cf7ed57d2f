"""Eq. 5-6: from votes to cell histograms, as one matrix for the rows and one for the columns."""

from __future__ import annotations

from torch import Tensor

from .spec import HOGSpec


def pooling_matrices(spec: HOGSpec, height: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Weights (rows, height) and (cols, width) of pixels in cells along either axis, dtype and device of ``like``."""
    ring = spec.border == "ignore"
    by_row, by_col = (
        spec.pooling.weights(pixels, cells, cell, axis, ring, like)
        for axis, (pixels, cells, cell) in enumerate(
            zip((height, width), spec.cells(height, width), spec.cell_size, strict=True)
        )
    )
    return by_row, by_col


def pool(votes: Tensor, spec: HOGSpec) -> Tensor:
    """F^s of Eq. 5-6: votes (B, bins, H, W) to cell histograms (B, bins, rows, cols).  Linear."""
    height, width = votes.shape[-2:]
    by_row, by_col = pooling_matrices(spec, height, width, votes)
    return by_row @ (votes @ by_col.T)
