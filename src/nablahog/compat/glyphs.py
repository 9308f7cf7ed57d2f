"""The picture of a HOG that ``skimage.feature.hog`` draws."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from skimage.draw import line
from torch import Tensor


def glyphs(cells: Tensor, cell_size: tuple[int, int], size: tuple[int, int], dtype: torch.dtype) -> Tensor:
    """A line in each cell for each bin, at right angles to the gradients that vote for it, where lines meet their sum.

    Args:
        cells: (bins, rows, cols), what is drawn.
        cell_size: (height, width) in pixels.
        size: (height, width) of the picture.
        dtype: of the picture, and of the sums.

    Returns:
        The picture, on the device of ``cells``; linear in them.

    Raises:
        ValueError: cells are one pixel wide, and a line leaves the picture.
    """
    pixels, entries = (torch.from_numpy(index).to(cells.device) for index in _strokes(cells.shape, cell_size, size[1]))
    picture = torch.zeros(size[0] * size[1], dtype=dtype, device=cells.device)
    return picture.index_add(0, pixels, cells.flatten()[entries].to(dtype)).reshape(size)


def _strokes(
    shape: tuple[int, ...], cell_size: tuple[int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which pixel, of a flat picture, gets which entry, of flat cells."""
    bins, rows, cols = shape
    radius = min(cell_size) // 2 - 1
    angles = np.pi * (np.arange(bins) + 0.5) / bins
    down, right = radius * np.cos(angles), radius * np.sin(angles)
    y, x = (np.arange(n) * side + side // 2 for n, side in zip((rows, cols), cell_size, strict=True))
    entries = np.arange(bins * rows * cols).reshape(shape)
    pixels, drawn = [], []
    for k in range(bins):
        # ends are cut to integers where they are, not where the cell's centre is: rounding may tell cells apart
        top, left = np.trunc(y - down[k]).astype(int), np.trunc(x + right[k]).astype(int)
        if left.min() < 0:
            raise ValueError(f"{bins} lines in cells of one pixel's width leave the picture, which needs wider cells")
        rise, run = np.trunc(y + down[k]).astype(int) - top, np.trunc(x - right[k]).astype(int) - left
        for dy in np.unique(rise):
            for dx in np.unique(run):
                below, beside = line(0, 0, dy, dx)  # type: ignore[no-untyped-call]
                of_rows, of_cols = rise == dy, run == dx
                start = top[of_rows, None] * width + left[of_cols]
                stroke = start[..., None] + (below * width + beside)
                pixels.append(stroke.ravel())
                drawn.append(np.broadcast_to(entries[k][np.ix_(of_rows, of_cols)][..., None], stroke.shape).ravel())
    return np.concatenate(pixels), np.concatenate(drawn)
