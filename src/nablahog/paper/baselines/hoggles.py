"""HOGgles: a descriptor is inverted window by window, with a pair of dictionaries that share their codes.

Vondrick, Khosla, Malisiewicz and Torralba, *HOGgles: Visualizing Object Detection Features* (ICCV 2013).  Each window
of 5x5 cells gets a sparse positive code in a dictionary of windows.  The same code in the dictionary of gray patches
gives a patch of 7x7 cells: the window and the ring of cells that its blocks depend on.  Overlapping patches are
averaged.

All numbers are those of the published code, with two differences.  The published descriptor drops the outermost ring of
cells and has a truncation channel that is always 0; here all cells and channels count.  The published code cuts the
image out one pixel too far to the upper left.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import fold, pad

from ...hog.normalizers import Footprint
from ...hog.spec import HOGSpec
from ...invert.arguments import check_descriptor
from ...invert.prior.provenance import Learning
from ...invert.reconstruction import Reconstruction, relative_distance
from ...io.learned_model import NUMBER, SPEC, TENSOR, LearnedModel, account, check_tensor
from ...runtime.extras import extra
from ...runtime.text import counted

WINDOW_CELLS = 5  # of a window's side
MARGIN_CELLS = 1  # cells on each side by which a patch is larger
PATCH_CELLS = WINDOW_CELLS + 2 * MARGIN_CELLS  # cells of a patch's side
PADDING = 5  # empty cells around a descriptor
PATCH_SIGMA = 9 / 8  # cells: of the Gaussian that weights the pixels of a patch
MAX_ATOM_ENTRY = 1 + 1e-5  # entry of an atom, whose length is at most 1, up to rounding
EPSILON = float(np.finfo(np.float64).eps)  # added to a window's energy
ROUNDING = 1e-5  # relative to the largest pixel: less contrast counts as none
CODE_TOLERANCE = 1e-3  # of ‖x‖²: how far the objective of a code may be above its minimum
WINDOW_BATCH = 4096  # windows whose patches are in memory at a time, or those of one descriptor


@dataclass(frozen=True, kw_only=True)
class HogglesLearning(Learning):
    """How a pair of dictionaries was learned: the numbers of windows and batches (0: the atoms are random windows).

    The objective is the mean of ½‖x - Dα‖² + λ‖α‖₁ over every hundredth batch, before it changes the dictionary.
    """

    windows: int
    iterations: int
    batch: int
    objective: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class PairedDictionary(LearnedModel):
    """Atoms of gray patches and of HOG windows, in pairs: the k-th patch is what the k-th window looks like.

    As published, an image is stretched to 0…1 together with the pixels beyond its edge, which are then cut off.

    Attributes:
        spec: the dialect that it was learned for.
        gray: (K, 7 · cell height, 7 · cell width), float32.
        hog: (K, 5, 5, channels), float32.
        sparsity: λ of the codes, above 0.
        learning: how it was learned.
    """

    KIND = "dictionary pair"
    NOUN = "dictionary"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "gray": TENSOR,
        "hog": TENSOR,
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
        check_tensor("gray", self.gray, torch.float32, (atoms, *patch_size(self.spec)), -MAX_ATOM_ENTRY, MAX_ATOM_ENTRY)
        windows_shape = (atoms, WINDOW_CELLS, WINDOW_CELLS, self.spec.channels)
        check_tensor("hog", self.hog, torch.float32, windows_shape, -MAX_ATOM_ENTRY, MAX_ATOM_ENTRY)
        check_sparsity(self.sparsity)

    @property
    def summary(self) -> str:
        return f"{counted(len(self.gray), 'pair')} of atoms, {counted(len(self.learning.images), 'image')}"

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, f"the {self.NOUN}")

    @torch.no_grad()
    def reconstruct(
        self, descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int] | None = None
    ) -> Reconstruction:
        """Images from descriptors, as :func:`nablahog.reconstruct`, in float32.  Nothing is random.

        The model does not know brightness and contrast: each image is stretched so that its darkest pixel is 0 and its
        brightest 1.  An image without contrast is 0.5.  The operator is never evaluated: the history is empty, (0, B).

        Raises:
            TypeError, ValueError: as ``reconstruct``; the spec is not the model's; scikit-learn is not installed.
        """
        began = time.perf_counter()
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        count, rows, cols = descriptor.shape[:3]
        batch = max(1, WINDOW_BATCH // math.prod(side + 2 * PADDING - WINDOW_CELLS + 1 for side in (rows, cols)))
        image = torch.cat([self._invert(some.float(), size) for some in torch.split(descriptor, batch)])
        return Reconstruction(
            image,
            relative_distance(image, descriptor.float(), spec),
            ["all windows are done"] * count,
            descriptor.new_zeros(0, count),
            torch.zeros(count, dtype=torch.long),
            time.perf_counter() - began,
        )

    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        """Images (B, 1, height, width) of ``size`` from descriptors (B, rows, cols, channels), float32."""
        x = hog_windows(pad(descriptor, (0, 0, PADDING, PADDING, PADDING, PADDING)))
        codes = positive_lasso(self.hog.flatten(1), unit(x.flatten(3).flatten(0, 2)), self.sparsity)
        patches = (codes @ (self.gray * _gaussian(self.spec)).flatten(1)).view(*x.shape[:3], -1)
        top, left = ((PADDING + MARGIN_CELLS) * cell for cell in self.spec.cell_size)
        return _stretch(_average_patches(patches, self.spec))[..., top : top + size[0], left : left + size[1]]


def check_cells(spec: HOGSpec) -> None:
    """Raises ValueError unless entry (row, col) of a descriptor is that of the cell (row, col), where patches lie."""
    if any(spec.normalizer.footprint(axis) != Footprint() for axis in (0, 1)):
        raise ValueError(
            f"windows can be learned only for descriptors with one entry for each cell: {spec.name} has blocks, or "
            "leaves out the outermost cells"
        )


def check_sparsity(sparsity: float) -> None:
    """Raises ValueError unless λ is finite and above 0."""
    if not 0 < sparsity < math.inf:
        raise ValueError(f"sparsity must be a finite number above 0, got {sparsity}")


def patch_size(spec: HOGSpec) -> tuple[int, int]:
    """(height, width) of a gray patch in pixels."""
    return PATCH_CELLS * spec.cell_size[0], PATCH_CELLS * spec.cell_size[1]


def positive_lasso(atoms: Tensor, vectors: Tensor, sparsity: float) -> Tensor:
    """The codes α ≥ 0 (N, K) that minimise ½‖x - Dα‖² + λ‖α‖₁ of vectors x (N, n), with atoms Dᵀ (K, n), all float32.

    By scikit-learn's coordinate descent, within ‖x‖² / 1000 of the minimum; ValueError if it is not installed.
    """
    with extra("sklearn", "HOGgles"):
        from sklearn.linear_model import Lasso
    codes = vectors.new_zeros(len(vectors), len(atoms))
    nonzero = vectors.any(1)  # the codes of zero windows are 0, and some versions warn of these
    if nonzero.any():
        gram = (atoms @ atoms.T).numpy()
        options = {"fit_intercept": False, "copy_X": False, "precompute": gram, "positive": True, "tol": CODE_TOLERANCE}
        lasso = Lasso(sparsity / atoms.shape[1], **options)
        lasso.fit(atoms.contiguous().numpy().T, vectors[nonzero].numpy().T, check_input=False)
        codes[nonzero] = torch.from_numpy(lasso.coef_.reshape(-1, len(atoms)))
    return codes


def hog_windows(descriptor: Tensor) -> Tensor:
    """All windows of descriptors (B, rows, cols, channels): (B, rows - 4, cols - 4, 5, 5, channels), a view."""
    return descriptor.unfold(1, WINDOW_CELLS, 1).unfold(2, WINDOW_CELLS, 1).permute(0, 1, 2, 4, 5, 3)


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
        side = torch.exp(-0.5 * (offset / (PATCH_SIGMA * cell)) ** 2)
        sides.append(side / side.sum())
    return torch.outer(*sides)


def _average_patches(patches: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) that are at each pixel the mean of all patches over it.

    Patches (B, rows, cols, pixels of one) lie one cell apart, so images have rows + 6 by cols + 6 cells.
    """
    rows, cols = patches.shape[1:3]
    canvas = ((rows + PATCH_CELLS - 1) * spec.cell_size[0], (cols + PATCH_CELLS - 1) * spec.cell_size[1])
    columns, patch = patches.flatten(1, 2).mT, patch_size(spec)
    total = fold(columns, canvas, patch, stride=spec.cell_size)
    return total / fold(torch.ones_like(columns[:1]), canvas, patch, stride=spec.cell_size)


def _stretch(image: Tensor) -> Tensor:
    """Images (B, 1, H, W), each with its darkest pixel at 0 and its brightest at 1; one without contrast is 0.5."""
    low, high = image.amin((2, 3), keepdim=True), image.amax((2, 3), keepdim=True)
    contrast = high - low
    visible = contrast > ROUNDING * torch.maximum(high, -low)
    return torch.where(visible, (image - low) / torch.where(visible, contrast, 1), 0.5)
