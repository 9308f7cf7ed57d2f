"""Square windows of descriptors, one at each cell, and the patches of the image around the same cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import fold, pad

from ...hog.descriptor import hog
from ...hog.normalizers import Footprint
from ...hog.spec import HOGSpec
from ...invert import provenance
from ...io.npz import naming

ROUNDING = 1e-5  # relative to the largest pixel: less contrast counts as none


class Pairs:
    """Windows of the descriptors of images, with their patches.

    Args:
        images: (H, W) each, float32 in 0…1.
        spec: the dialect.
        cells: of the side of a window and a patch, odd.
        most: windows in all; of more, so many are drawn at random.
        rng: of the draw.

    Iterating gives, for each image, windows (N, cells² · channels) and patches (N, pixels of one), float32.
    """

    def __init__(
        self, images: Sequence[Tensor], spec: HOGSpec, cells: int, most: int, rng: np.random.Generator
    ) -> None:
        self.images, self.spec, self.cells = images, spec, cells
        self.ends = np.cumsum([math.prod(spec.grid(*image.shape)) for image in images])
        self.chosen: NDArray[np.int64] = np.sort(rng.permutation(self.ends[-1])[:most])

    def __len__(self) -> int:
        return len(self.chosen)

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        first = 0
        for image, end in zip(self.images, self.ends.tolist(), strict=True):
            low, high = np.searchsorted(self.chosen, [first, end])
            which = torch.from_numpy(self.chosen[low:high] - first)
            first = end
            descriptor = hog(image[None, None], self.spec)
            windows = windows_at_cells(descriptor, self.cells)[0].flatten(0, 1)
            yield windows[which], self._patches(image, descriptor.shape[1:3], which)

    def _patches(self, image: Tensor, grid: torch.Size, which: Tensor) -> Tensor:
        """Patches of the chosen cells of an image, whose outermost pixels are repeated around it."""
        down, across = (
            (torch.arange((count + self.cells - 1) * cell) - self.cells // 2 * cell).clamp(0, side - 1)
            for count, cell, side in zip(grid, self.spec.cell_size, image.shape, strict=True)
        )
        (height, width), (cell_height, cell_width) = patch_size(self.spec, self.cells), self.spec.cell_size
        patches = image[down[:, None], across].unfold(0, height, cell_height).unfold(1, width, cell_width)
        return patches[which // grid[1], which % grid[1]].flatten(1)


def patch_size(spec: HOGSpec, cells: int) -> tuple[int, int]:
    """(height, width) of a patch of so many cells, in pixels."""
    return cells * spec.cell_size[0], cells * spec.cell_size[1]


def windows_at_cells(descriptor: Tensor, cells: int) -> Tensor:
    """The window around each cell of (B, rows, cols, channels), zero beyond: (B, rows, cols, cells² · channels)."""
    margin = cells // 2
    padded = pad(descriptor, (0, 0, margin, margin, margin, margin))
    return padded.unfold(1, cells, 1).unfold(2, cells, 1).permute(0, 1, 2, 4, 5, 3).flatten(3)


def average_patches(patches: Tensor, spec: HOGSpec, cells: int) -> Tensor:
    """Images (B, 1, H, W) that are at each pixel the mean of all patches over it.

    Args:
        patches: (B, rows, cols, pixels of one), one cell apart.
        spec: the dialect.
        cells: of the side of a patch.

    Returns:
        Images of (rows + cells - 1) · (cols + cells - 1) cells.
    """
    rows, cols = patches.shape[1:3]
    canvas = ((rows + cells - 1) * spec.cell_size[0], (cols + cells - 1) * spec.cell_size[1])
    columns, patch = patches.flatten(1, 2).mT, patch_size(spec, cells)
    total = fold(columns, canvas, patch, stride=spec.cell_size)
    return total / fold(torch.ones_like(columns[:1]), canvas, patch, stride=spec.cell_size)


def crop(image: Tensor, spec: HOGSpec, border: int, size: tuple[int, int]) -> Tensor:
    """The part (B, 1, height, width) of ``size`` that begins ``border`` cells inside images (B, 1, H, W)."""
    top, left = (border * cell for cell in spec.cell_size)
    return image[..., top : top + size[0], left : left + size[1]]


def stretched(image: Tensor) -> Tensor:
    """Images (B, 1, H, W), each with its darkest pixel at 0 and its brightest at 1; one without contrast is 0.5."""
    low, high = image.amin((2, 3), keepdim=True), image.amax((2, 3), keepdim=True)
    contrast = high - low
    visible = contrast > ROUNDING * torch.maximum(high, -low)
    return torch.where(visible, (image - low) / torch.where(visible, contrast, 1), 0.5)


def check_cells(spec: HOGSpec) -> None:
    """Raises ValueError unless entry (row, col) of a descriptor is that of the cell (row, col).

    Otherwise patches would not lie on their windows.
    """
    if any(spec.normalizer.footprint(axis) != Footprint() for axis in (0, 1)):
        raise ValueError(
            f"windows can be learned of descriptors that have each cell for itself only: {spec.name} has blocks, or "
            "leaves the outermost cells out"
        )


def check_images(images: Mapping[str, Tensor], spec: HOGSpec) -> list[str]:
    """The names of images to learn from, sorted.

    Raises:
        ValueError: there are none, or one is too small or holds other values; the spec is none for :func:`check_cells`.
    """
    check_cells(spec)
    names = provenance.check_images(images)
    for name in names:
        with naming(name):
            spec.grid(*images[name].shape)
    return names
