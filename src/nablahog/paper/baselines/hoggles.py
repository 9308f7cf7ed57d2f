"""HOGgles: a descriptor is inverted window by window, with a pair of dictionaries that share their codes.

Vondrick, Khosla, Malisiewicz and Torralba, *HOGgles: Visualizing Object Detection Features* (ICCV 2013).  A window of
5x5 cells has a sparse positive code in a dictionary of windows (:mod:`.lasso`); the same code in the dictionary of gray
patches gives a patch of 7x7 cells: the window and the cells around it, which its blocks depend on.  Overlapping patches
are averaged.  :func:`.hoggles_learning.learn_hoggles` learns the pair.

All numbers are those of the published code.  Three things differ: its descriptor leaves out the outermost ring of cells
and has a truncation channel that is always 0, here all cells and channels count; and it cuts the image out one pixel
too far to the upper left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from ...hog.spec import HOGSpec
from ...invert.provenance import Learning
from ...io.learned_model import NUMBER, SPEC, account, check_tensor, tensor
from . import windows
from .lasso import check_sparsity, lasso
from .window_model import WindowModel
from .windows import average_patches, crop, stretched

CELLS = 5  # of a window's side
MARGIN = 1  # cells on each side by which a patch is larger
PATCH = CELLS + 2 * MARGIN  # cells of a patch's side
PADDING = 5  # empty cells around a descriptor
SIGMA = 9 / 8  # cells: of the Gaussian that weighs the pixels of a patch
LARGEST = 1 + 1e-5  # entry of an atom, whose length is at most 1, up to rounding
EPSILON = float(np.finfo(np.float64).eps)  # added to a window's energy
BATCH = 4096  # windows whose patches are in memory at a time, or those of one descriptor


@dataclass(frozen=True, kw_only=True)
class HogglesLearning(Learning):
    """How a pair of dictionaries was learned.

    Attributes:
        windows: how many there were to draw from.
        iterations: batches of windows; 0 if the atoms are random windows.
        batch: windows of each.
        objective: the mean of ½‖x - Dα‖² + λ‖α‖₁ over each 100 iterations, before the batch changes the dictionary.
    """

    windows: int
    iterations: int
    batch: int
    objective: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class PairedDictionary(WindowModel):
    """Atoms of gray patches and of HOG windows, in pairs: the k-th patch is what the k-th window looks like.

    As published, an image is stretched to 0…1 together with the pixels beyond its edge, which are then cut off.

    Attributes:
        spec: the dialect that it was learned for.
        gray: (K, 7 · cell height, 7 · cell width), float32.
        hog: (K, 5, 5, channels), float32.
        sparsity: λ of the codes, above 0.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or entries beyond ±1; of its methods, scikit-learn is
            not installed.
    """

    KIND = "dictionary pair"
    NOUN = "dictionary"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "gray": tensor(np.float32),
        "hog": tensor(np.float32),
        "sparsity": NUMBER,
        "learning": account(HogglesLearning),
    }

    spec: HOGSpec
    gray: Tensor
    hog: Tensor
    sparsity: float
    learning: HogglesLearning

    def __post_init__(self) -> None:
        atoms = self.gray.shape[0] if self.gray.dim() else 0
        check_tensor("gray", self.gray, torch.float32, (atoms, *patch_size(self.spec)), -LARGEST, LARGEST)
        windows_shape = (atoms, CELLS, CELLS, self.spec.channels)
        check_tensor("hog", self.hog, torch.float32, windows_shape, -LARGEST, LARGEST)
        check_sparsity(self.sparsity)

    @property
    def summary(self) -> str:
        return f"{len(self.gray)} pairs of atoms, {len(self.learning.images)} images"

    def _batch_size(self, rows: int, cols: int) -> int:
        return max(1, BATCH // math.prod(side + 2 * PADDING - CELLS + 1 for side in (rows, cols)))

    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        x = hog_windows(pad(descriptor, (0, 0, PADDING, PADDING, PADDING, PADDING)))
        codes = lasso(self.hog.flatten(1), unit(x.flatten(3).flatten(0, 2)), self.sparsity)
        patches = (codes @ (self.gray * _gaussian(self.spec)).flatten(1)).view(*x.shape[:3], -1)
        return crop(stretched(average_patches(patches, self.spec, PATCH)), self.spec, PADDING + MARGIN, size)


def patch_size(spec: HOGSpec) -> tuple[int, int]:
    """(height, width) of a gray patch in pixels."""
    return windows.patch_size(spec, PATCH)


def hog_windows(descriptor: Tensor) -> Tensor:
    """All windows of descriptors (B, rows, cols, channels): (B, rows - 4, cols - 4, 5, 5, channels), a view."""
    return descriptor.unfold(1, CELLS, 1).unfold(2, CELLS, 1).permute(0, 1, 2, 4, 5, 3)


def unit(vectors: Tensor) -> Tensor:
    """Vectors (N, n) of mean 0 and length 1, float32; one that is constant becomes 0."""
    centred = vectors.double()  # in float32 the rounding of a mean would be taken for contrast
    centred = centred - centred.mean(1, keepdim=True)
    return (centred / (centred.square().sum(1, keepdim=True) + EPSILON).sqrt()).float()


def _gaussian(spec: HOGSpec) -> Tensor:
    """The weights of the pixels of a patch, (height, width), of sum 1."""
    sides = []
    for pixels, cell in zip(patch_size(spec), spec.cell_size, strict=True):
        offset = torch.arange(pixels) - (pixels - 1) / 2
        side = torch.exp(-0.5 * (offset / (SIGMA * cell)) ** 2)
        sides.append(side / side.sum())
    return torch.outer(*sides)
