"""The filter of Eq. 5 along one axis."""

from __future__ import annotations

import torch
from torch import Tensor


def triangles(pixels: int, cell: int, cells: int, like: Tensor) -> Tensor:
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
