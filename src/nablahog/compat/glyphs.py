"""The HOG image of ``skimage.feature.hog(visualize=True)``."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from skimage.draw import line
from torch import Tensor


def glyphs(cells: Tensor, cell_size: tuple[int, int], size: tuple[int, int], dtype: torch.dtype) -> Tensor:
    """Draws a line in each cell for each bin, at right angles to its gradients; lines that meet add up.

    Args:
        cells: (bins, rows, cols), the brightness of the lines.
        cell_size: (height, width) in pixels.
        size: (height, width) of the image.
        dtype: of the image, and of the sums.

    Returns:
        The image, on the device of ``cells``; differentiable, linear in them.

    Raises:
        ValueError: cells are one pixel wide, and a line leaves the image.
    """
    pixels, entries = (torch.from_numpy(index).to(cells.device) for index in _strokes(cells.shape, cell_size, size[1]))
    image = torch.zeros(size[0] * size[1], dtype=dtype, device=cells.device)
    return image.index_add(0, pixels, cells.flatten()[entries].to(dtype)).reshape(size)


def _strokes(
    shape: tuple[int, ...], cell_size: tuple[int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels of a flat image, and the entry of flat cells to add to each."""
    bins, rows, cols = shape
    radius = min(cell_size) // 2 - 1
    angles = np.pi * (np.arange(bins) + 0.5) / bins
    down, right = radius * np.cos(angles), radius * np.sin(angles)
    y, x = (np.arange(n) * side + side // 2 for n, side in zip((rows, cols), cell_size, strict=True))
    entries = np.arange(bins * rows * cols).reshape(shape)
    pixels, drawn = [], []
    for k in range(bins):
        # the absolute ends are truncated, not those relative to the cell's centre: cells may differ by rounding
        top, left = np.trunc(y - down[k]).astype(int), np.trunc(x + right[k]).astype(int)
        if left.min() < 0:
            raise ValueError(f"{bins} lines leave the picture in cells of one pixel's width; use wider cells")
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
