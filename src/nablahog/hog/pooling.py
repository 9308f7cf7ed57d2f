"""Eq. 5-6: from votes to cell histograms, as one matrix for the rows and one for the columns."""

from __future__ import annotations

import torch
from torch import Tensor

from .poolings import BilinearCells, BlockCells, BoxCells
from .spec import HOGSpec


def pooling_matrices(spec: HOGSpec, height: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Weights (rows, height) and (cols, width) of pixels in cells along either axis, dtype and device of ``like``."""
    rows, cols = spec.cells(height, width)
    return _matrix(spec, 0, height, rows, like), _matrix(spec, 1, width, cols, like)


def _matrix(spec: HOGSpec, axis: int, pixels: int, cells: int, like: Tensor) -> Tensor:
    cell, ring, scheme = spec.cell_size[axis], spec.border == "ignore", spec.pooling
    if isinstance(scheme, BlockCells):
        matrix = _within_blocks(pixels, cell, scheme.block[axis], scheme.step[axis], scheme.sigma, like)
    elif isinstance(scheme, BoxCells):
        matrix = _boxes(pixels, cell, cells, scheme, like)
    else:
        return _bilinear(pixels, cell, cells, scheme, ring, like)
    if ring:
        matrix[:, [0, -1]] = 0
    return matrix


def _triangles(positions: Tensor, cells: int) -> Tensor:
    """f^s of Eq. 5 along one axis, (cells, n): 1 - distance to each cell's centre, at least 0, positions in cells."""
    return (1 - (positions - torch.arange(cells).to(positions).unsqueeze(1)).abs()).clamp(min=0)


def _positions(pixels: int, cell: int, like: Tensor) -> Tensor:
    """Where the centres of pixels are, in cells, the centre of the first cell being 0."""
    return (torch.arange(pixels, dtype=like.dtype, device=like.device) + 0.5) / cell - 0.5


def _bilinear(pixels: int, cell: int, cells: int, scheme: BilinearCells, ring: bool, like: Tensor) -> Tensor:
    """Row k is the bilinear filter of Eq. 5 along one axis, placed at the centre of cell k (Eq. 6).

    Two neighbouring cells share each pixel between their centres.
    """
    # pixels 0 … last - 1 of the cells, or of the image, vote; without the first and the last if there is a ring
    last = {"vote": pixels, "drop": min(cells * cell, pixels), "repeat": cells * cell}[scheme.beyond]
    matrix = _triangles(_positions(max(last, pixels), cell, like), cells)
    matrix[:, last:] = 0
    if ring:
        matrix[:, [0, last - 1]] = 0
    if last > pixels:  # DPM: what the image lacks is its last pixel that votes, again
        of_last = max(pixels - 1 - ring, 0)
        matrix[:, of_last] += matrix[:, of_last + 1 :].sum(dim=1)
        matrix[:, of_last + 1 :] = 0
    gain = torch.ones(cells, 1).to(like)
    gain[[0, -1]] = scheme.edge_gain
    return matrix[:, :pixels] * gain


def _boxes(pixels: int, cell: int, cells: int, scheme: BoxCells, like: Tensor) -> Tensor:
    pixel = torch.arange(pixels, device=like.device)
    matrix = (pixel // cell == torch.arange(cells, device=like.device).unsqueeze(1)).to(like)
    if scheme.mean:
        matrix = matrix / cell
    if scheme.window:
        side = torch.arange(scheme.window, dtype=like.dtype, device=like.device)
        weights = torch.exp(-0.5 * ((side - side.mean()) / (scheme.window // 2)) ** 2)
        matrix = matrix * (weights / weights.sum())[pixel % scheme.window]
    return matrix


def _within_blocks(pixels: int, cell: int, block: int, step: int, sigma: float, like: Tensor) -> Tensor:
    """Of each block in turn its cells, by rows."""
    inside = torch.arange(block, dtype=like.dtype, device=like.device)
    weights = _triangles(_positions(block, cell, like), block // cell)
    weights = weights * torch.exp(-((inside - block / 2) ** 2) / (2 * sigma**2))
    matrix = like.new_zeros((pixels - block) // step + 1, block // cell, pixels)
    for k, of_block in enumerate(matrix):
        of_block[:, k * step : k * step + block] = weights
    return matrix.flatten(0, 1)


def pool(votes: Tensor, spec: HOGSpec) -> Tensor:
    """F^s of Eq. 5-6: votes (B, bins, H, W) to cell histograms (B, bins, rows, cols).  Linear."""
    height, width = votes.shape[-2:]
    by_row, by_col = pooling_matrices(spec, height, width, votes)
    return by_row @ (votes @ by_col.T)
