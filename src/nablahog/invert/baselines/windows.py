"""Square windows of descriptors, one at each cell, and the patches of the image around the same cells."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import fold, pad

from ...hog.descriptor import hog
from ...hog.normalizers import Footprint
from ...hog.spec import HOGSpec
from ..preimage import Reconstruction, relative_distance

ROUNDING = 1e-5  # of the largest pixel: less contrast than that is none


class Pairs:
    """Windows of the descriptors of images, with their patches; some of them at random if there are too many.

    Args:
        images: (H, W) each, float32 in 0…1.
        spec: the dialect.
        cells: of the side of a window and a patch, odd.
        most: windows in all.
        rng: decides which.

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
        """Around the image its outermost pixels are repeated."""
        down, across = (
            (torch.arange((count + self.cells - 1) * cell) - self.cells // 2 * cell).clamp(0, side - 1)
            for count, cell, side in zip(grid, self.spec.cell_size, image.shape, strict=True)
        )
        (high, wide), (down_by, across_by) = patch_size(self.spec, self.cells), self.spec.cell_size
        cut = image[down[:, None], across].unfold(0, high, down_by).unfold(1, wide, across_by)
        row, col = which // grid[1], which % grid[1]
        return cut[row, col].flatten(1)


def patch_size(spec: HOGSpec, cells: int) -> tuple[int, int]:
    """(height, width) of a patch of so many cells, in pixels."""
    return cells * spec.cell_size[0], cells * spec.cell_size[1]


def windows_at_cells(descriptor: Tensor, cells: int) -> Tensor:
    """The window around each cell of (B, rows, cols, channels), zero beyond: (B, rows, cols, cells² · channels)."""
    around = cells // 2
    bordered = pad(descriptor, (0, 0, around, around, around, around))
    return bordered.unfold(1, cells, 1).unfold(2, cells, 1).permute(0, 1, 2, 4, 5, 3).flatten(3)


def mean_of_patches(patches: Tensor, spec: HOGSpec, cells: int, size: tuple[int, int]) -> Tensor:
    """Images (B, 1, height, width) of ``size``, at each pixel the mean of all patches (B, rows, cols, n) over it."""
    rows, cols = patches.shape[1:3]
    canvas = ((rows + cells - 1) * spec.cell_size[0], (cols + cells - 1) * spec.cell_size[1])
    columns, patch = patches.flatten(1, 2).mT, patch_size(spec, cells)
    total = fold(columns, canvas, patch, stride=spec.cell_size)
    image = total / fold(torch.ones_like(columns[:1]), canvas, patch, stride=spec.cell_size)
    top, left = (cells // 2 * cell for cell in spec.cell_size)
    return image[..., top : top + size[0], left : left + size[1]]


def without_search(image: Tensor, descriptor: Tensor, spec: HOGSpec, image_of: str, began: float) -> Reconstruction:
    """What was found without any evaluation of the operator, of which there is therefore no history.

    Args:
        image: (B, 1, H, W).
        descriptor: (B, rows, cols, channels), whose dtype and device the image gets.
        spec: its dialect.
        image_of: what the images were made of, for the reason why nothing more was done.
        began: ``time.perf_counter`` when it began.
    """
    image, count = image.to(descriptor), len(descriptor)
    return Reconstruction(
        image,
        relative_distance(image, descriptor, spec),
        [f"all {image_of}"] * count,
        descriptor.new_zeros(0, count),
        torch.zeros(count, dtype=torch.long, device=descriptor.device),
        time.perf_counter() - began,
    )


def stretched(image: Tensor) -> Tensor:
    """Images (B, 1, H, W), each with its darkest pixel at 0 and its brightest at 1; one without contrast is 0.5."""
    low, high = image.amin((2, 3), keepdim=True), image.amax((2, 3), keepdim=True)
    contrast = high - low
    visible = contrast > ROUNDING * torch.maximum(high, -low)
    return torch.where(visible, (image - low) / torch.where(visible, contrast, 1), 0.5)


def check_cells(spec: HOGSpec) -> None:
    """Raises ValueError unless a descriptor has a row of channels for each cell, where the cell is.

    The first rows of others are not those of the first cells, so that patches would not lie on their windows.
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
    if not images:
        raise ValueError("expected images to learn from, got none")
    for name, image in images.items():
        if image.dim() != 2 or image.dtype != torch.float32 or not ((image >= 0) & (image <= 1)).all():
            raise ValueError(f"{name}: expected an image (H, W) of float32 in 0…1")
        try:
            spec.grid(*image.shape)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    return sorted(images)
