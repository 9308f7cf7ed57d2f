"""What an empty cell says: every pixel that votes into it has no gradient at all.

A normaliser divides the faintest texture up to full strength, so "almost flat" and "flat" have very different
descriptors, and between them lies a plateau on which no descent finds its way.  Images from cameras and scanners do
have exactly flat, saturated regions.  Where the descriptor of a cell is zero, the image is therefore constant by
construction: one gray value for each connected region.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from scipy import ndimage
from torch import Tensor

from ..hog.entries import cell_entries, covered_cells, of_nearest_cells
from ..hog.pooling import pooling_matrices
from ..hog.spec import HOGSpec
from . import kernels


class FlatRegions:
    """Replaces each region that must be constant by its mean.  Linear; the identity where there is none."""

    def __init__(self, descriptor: Tensor, spec: HOGSpec, height: int, width: int) -> None:
        entries = of_nearest_cells(cell_entries(descriptor, spec), spec, (height, width))
        rows, cols = (covered.to(descriptor.device) for covered in covered_cells(spec, (height, width)))
        empty = (entries == 0).all(dim=1) & rows.unsqueeze(1) & cols
        by_row, by_col = (matrix > 0 for matrix in pooling_matrices(spec, height, width, descriptor))
        silent = (by_row.T.to(descriptor) @ empty.to(descriptor) @ by_col.to(descriptor)) > 0
        # a pixel without gradient has equal neighbours; that the pixel itself equals them is the smoothest choice
        cross = ndimage.generate_binary_structure(2, 1)[np.newaxis]
        joined = ndimage.binary_dilation(silent.cpu().numpy(), cross)
        in_plane = np.zeros((3, 3, 3), dtype=bool)
        in_plane[1] = cross[0]
        regions, count = ndimage.label(joined, in_plane)
        self.regions = torch.from_numpy(regions.astype(np.int32)).to(descriptor.device)  # (B, H, W), 0: none
        self.sizes = torch.bincount(self.regions.flatten(), minlength=count + 1).double()
        self.runs = _runs(regions.reshape(len(regions), -1))

    def level(self, image: Tensor, index: Tensor) -> Tensor:
        """As a call, in place, where no derivative is needed."""
        if len(self.sizes) == 1 or image.device.type != "cpu":
            return self(image, index)
        return kernels.level(image.contiguous(), index, *self.runs, self.sizes)

    def __call__(self, image: Tensor, index: Tensor) -> Tensor:
        """Images (A, 1, H, W) of the problems ``index`` (A,), with their regions made constant."""
        if len(self.sizes) == 1:
            return image
        if image.device.type == "cpu":
            return kernels.levelled(image, index, *self.runs, self.sizes)
        regions = self.regions[index].unsqueeze(1).long()
        # a region may hold most of the image: float32 would round its sum by more than a gray value's own rounding
        sums = torch.zeros_like(self.sizes).index_add(0, regions.flatten(), image.flatten().double())
        return torch.where(regions > 0, (sums / self.sizes.clamp(min=1)).to(image.dtype)[regions], image)


def _runs(regions: npt.NDArray[np.integer]) -> tuple[Tensor, Tensor]:
    """Regions (B, pixels), 0 for none, as (runs, 3) and (B + 1,): see :func:`.kernels.levelled`."""
    before = np.pad(regions, ((0, 0), (1, 0)))
    after = np.pad(regions, ((0, 0), (0, 1)))
    changes = before != after  # (B, pixels + 1)
    images, begins = np.nonzero(changes[:, :-1] & (regions > 0))
    _, ends = np.nonzero(changes[:, 1:] & (regions > 0))
    runs = np.stack([begins, ends + 1, regions[images, begins]], axis=1)
    firsts = np.searchsorted(images, np.arange(len(regions) + 1))
    return torch.from_numpy(runs), torch.from_numpy(firsts)
