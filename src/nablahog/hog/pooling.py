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


def _triangles(pixels: int, cell: int, cells: int, like: Tensor) -> Tensor:
    """f^s of Eq. 5 along one axis, (cells, pixels): 1 - distance to each cell's centre in cells, at least 0.

    Distances are whole numbers of half pixels: a weight is rounded once, and alike wherever the cell is.
    """
    ahead = 2 * torch.arange(pixels, device=like.device) + 1 - cell  # of the centre of cell 0
    before = torch.div(ahead, 2 * cell, rounding_mode="floor")  # the cell whose centre is at the pixel's or before it
    of_next = (ahead - 2 * cell * before).to(like.dtype) / (2 * cell)
    of_this = (2 * cell * (before + 1) - ahead).to(like.dtype) / (2 * cell)
    # a row before the first cell and one after the last for the votes that leave the image
    matrix = torch.zeros(cells + 2, pixels, dtype=like.dtype, device=like.device)
    matrix.scatter_(0, (before + 1).clamp(max=cells + 1).unsqueeze(0), of_this.unsqueeze(0))
    matrix.scatter_(0, (before + 2).clamp(max=cells + 1).unsqueeze(0), of_next.unsqueeze(0))
    return matrix[1:-1]


def _bilinear(pixels: int, cell: int, cells: int, scheme: BilinearCells, ring: bool, like: Tensor) -> Tensor:
    """Row k is the bilinear filter of Eq. 5 along one axis, placed at the centre of cell k (Eq. 6).

    Two neighbouring cells share each pixel between their centres.
    """
    # pixels 0 … last - 1 of the cells, or of the image, vote; without the first and the last if there is a ring
    last = {"vote": pixels, "drop": min(cells * cell, pixels), "repeat": cells * cell}[scheme.beyond]
    matrix = _triangles(max(last, pixels), cell, cells, like)
    matrix[:, last:] = 0
    if ring:
        matrix[:, [0, last - 1]] = 0
    if last > pixels:  # DPM: what the image lacks is its last pixel that votes, again
        of_last = max(pixels - 1 - ring, 0)
        matrix[:, of_last] += matrix[:, of_last + 1 :].sum(dim=1)
        matrix = matrix[:, :pixels].contiguous()
        matrix[:, of_last + 1 :] = 0
    for outermost in {0, cells - 1}:
        matrix[outermost] *= scheme.edge_gain
    return matrix


def _boxes(pixels: int, cell: int, cells: int, scheme: BoxCells, like: Tensor) -> Tensor:
    pixel = torch.arange(pixels, device=like.device)
    weights = torch.ones(pixels, dtype=like.dtype, device=like.device)
    if scheme.mean:
        weights = weights / cell
    if scheme.window:
        side = torch.arange(scheme.window, dtype=like.dtype, device=like.device)
        window = torch.exp(-0.5 * ((side - side.mean()) / (scheme.window // 2)) ** 2)
        weights = weights * (window / window.sum())[pixel % scheme.window]
    # a row after the last cell for the pixels that are in none
    matrix = torch.zeros(cells + 1, pixels, dtype=like.dtype, device=like.device)
    own = torch.div(pixel, cell, rounding_mode="floor").clamp(max=cells)
    return matrix.scatter_(0, own.unsqueeze(0), weights.unsqueeze(0))[:-1]


def _within_blocks(pixels: int, cell: int, block: int, step: int, sigma: float, like: Tensor) -> Tensor:
    """Of each block in turn its cells, by rows."""
    inside = torch.arange(block, dtype=like.dtype, device=like.device)
    weights = _triangles(block, cell, block // cell, like)
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
