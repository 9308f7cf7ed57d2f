"""HOGgles: a descriptor is inverted window by window, with a pair of dictionaries that share their codes.

Vondrick, Khosla, Malisiewicz and Torralba, *HOGgles: Visualizing Object Detection Features* (ICCV 2013).  A window of
5x5 cells is coded with a few atoms of the descriptors' dictionary, all weights positive, and these weights make a gray
patch of 7x7 cells from the other dictionary: the cells and those around them that their blocks see.  Overlapping
patches are averaged.  :func:`.hoggles_learning.learn_hoggles` learns the pair.

All numbers are those of the published code.  Three things are not: its descriptor has no outermost ring of cells, but a
truncation channel that is always 0, and here all cells and channels of the given descriptor count; and it cuts the
image out one pixel too far to the upper left.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import fold, pad

from ...hog.spec import HOGSpec
from ...io.npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays
from ...runtime.compile import compiled
from ...runtime.threads import in_threads
from ..preimage import Reconstruction, check_descriptor
from .windows import stretched, without_search

FORMAT = 1
CELLS = 5  # of a window's side
AROUND = 1  # cell on each side, by which the gray patch is larger
PATCH = CELLS + 2 * AROUND  # cells of its side
BORDER = 5  # empty cells that a descriptor gets on each side
SIGMA = 9 / 8  # cells: of the Gaussian that weighs the pixels of a patch
LARGEST = 1 + 1e-5  # entry of an atom, none of which is longer than 1, up to rounding
NO_CONTRAST = float(np.finfo(np.float64).eps)  # added to a window's energy
EXACTNESS = 1e-2  # of the sparsity: how far the conditions of an optimum may be missed
MAX_ROUNDS = 200  # of a code; it takes some ten
TOGETHER = 4096  # windows whose patches are in memory at a time, or those of one descriptor
PORTION = 128  # windows that a thread codes in one go
_ARRAYS = ("format", "spec", "gray", "hog", "sparsity", "learning")


@dataclass(frozen=True)
class Learning:
    """How a pair of dictionaries was learned.

    Attributes:
        images: the names of the images, sorted.
        sha256: of the images, in this order, hexadecimal.
        windows: how many windows there were to draw from.
        iterations: batches of windows; 0 if the atoms are random windows.
        batch: windows of each.
        seed: of everything random.
        objective: the mean of ½‖x - Dα‖² + λ‖α‖₁ over each 100 iterations, of each batch before it is learned from.
    """

    images: tuple[str, ...]
    sha256: str
    windows: int
    iterations: int
    batch: int
    seed: int
    objective: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class PairedDictionary:
    """Atoms of gray patches and of HOG windows, in pairs: the k-th patch is what the k-th window looks like.

    Attributes:
        spec: the dialect that it was learned for.
        gray: (K, 7 · cell height, 7 · cell width), float32.
        hog: (K, 5, 5, channels), float32.
        sparsity: λ of the codes, above 0.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or what no unit vector holds.
    """

    spec: HOGSpec
    gray: Tensor
    hog: Tensor
    sparsity: float
    learning: Learning

    def __post_init__(self) -> None:
        atoms = self.gray.shape[0] if self.gray.dim() else 0
        shapes = {"gray": (atoms, *patch_size(self.spec)), "hog": (atoms, CELLS, CELLS, self.spec.channels)}
        for name, shape in shapes.items():
            array: Tensor = getattr(self, name)
            if array.dtype != torch.float32 or array.shape != shape or not atoms:
                raise ValueError(f"{name} must be float32 of shape {shape}, got {array.dtype} of {tuple(array.shape)}")
            if not (array.abs() <= LARGEST).all():  # NaN fails too
                raise ValueError(f"{name} must lie within ±1, got NaN, Inf or more")
        check_sparsity(self.sparsity)

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, "the dictionary")

    @torch.no_grad()
    def reconstruct(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        image_size: tuple[int, int] | None = None,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """Images from descriptors, the interface of :func:`nablahog.reconstruct`.  Nothing of it is random.

        As published, each image is stretched so that its darkest pixel is 0 and its brightest 1, those included that
        lie beyond its edge and are cut off at the end.  One without any contrast is 0.5.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device; computed in float32 on the CPU.
            spec: its dialect, which must be the dictionary's.
            image_size: (height, width); by default whole cells.
            progress: called with the descriptors done and their number.

        Returns:
            No evaluation of the operator is spent, so the history is empty, (0, B).

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the dictionary's.
        """
        began = time.perf_counter()
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        count = len(descriptor)
        atoms = self.hog.flatten(1)
        gram = atoms @ atoms.T
        windows = math.prod(side + 2 * BORDER - CELLS + 1 for side in descriptor.shape[1:3])
        together = max(1, TOGETHER // windows)
        images = []
        for first in range(0, count, together):
            if progress:
                progress(first, count)
            images.append(self._invert(descriptor[first : first + together].float().cpu(), atoms, gram, size))
        if progress:
            progress(count, count)
        return without_search(torch.cat(images), descriptor, spec, "windows are coded", began)

    def _invert(self, descriptor: Tensor, atoms: Tensor, gram: Tensor, size: tuple[int, int]) -> Tensor:
        """Images (B, 1, H, W) of descriptors (B, rows, cols, channels)."""
        cell, patch = self.spec.cell_size, patch_size(self.spec)
        bordered = pad(descriptor, (0, 0, BORDER, BORDER, BORDER, BORDER))
        batch, rows, cols = bordered.shape[:3]
        windows = unit(hog_windows(bordered).flatten(3).flatten(0, 2))
        codes = lasso(gram, windows @ atoms.T, self.sparsity)
        patches = (codes @ (self.gray * _weights(self.spec)).flatten(1)).view(batch, -1, math.prod(patch)).mT
        canvas = ((rows + 2 * AROUND) * cell[0], (cols + 2 * AROUND) * cell[1])
        total = fold(patches, canvas, patch, stride=cell)
        image = total / fold(torch.ones_like(patches[:1]), canvas, patch, stride=cell)
        image = stretched(image)
        top, left = ((BORDER + AROUND) * side for side in cell)
        return image[..., top : top + size[0], left : left + size[1]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is an .npz archive of the arrays ``format`` (1), ``spec`` (its JSON), ``gray``, ``hog``, ``sparsity`` and
        ``learning`` (JSON).

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {
            "spec": self.spec.to_json(),
            "gray": self.gray.numpy(),
            "hog": self.hog.numpy(),
            "sparsity": self.sparsity,
            "learning": account_to_text(self.learning),
        }
        write_arrays(path, FORMAT, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PairedDictionary:
        """The dictionary that :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
                arrays contradict each other.
        """
        arrays = read_arrays(path, "dictionary pair", _ARRAYS)
        with naming(path):
            check_format(arrays, "dictionary pair", FORMAT)
            gray, hog = (_singles(name, arrays[name]) for name in ("gray", "hog"))
            sparsity = arrays["sparsity"]
            if sparsity.shape != () or sparsity.dtype != np.float64:
                raise ValueError(f"sparsity must be one float64, got {sparsity.dtype} of shape {sparsity.shape}")
            spec = HOGSpec.from_json(text(arrays, "spec"))
            return cls(spec, gray, hog, float(sparsity.item()), account_of(Learning, text(arrays, "learning")))


def patch_size(spec: HOGSpec) -> tuple[int, int]:
    """(height, width) of a gray patch in pixels."""
    return PATCH * spec.cell_size[0], PATCH * spec.cell_size[1]


def check_sparsity(sparsity: float) -> None:
    """Raises ValueError unless codes may be so sparse."""
    if not 0 < sparsity < math.inf:
        raise ValueError(f"sparsity must be a finite number above 0, got {sparsity}")


def hog_windows(descriptor: Tensor) -> Tensor:
    """All windows of descriptors (B, rows, cols, channels): (B, rows - 4, cols - 4, 5, 5, channels), a view."""
    return descriptor.unfold(1, CELLS, 1).unfold(2, CELLS, 1).permute(0, 1, 2, 4, 5, 3)


def unit(vectors: Tensor) -> Tensor:
    """Vectors (N, n) of mean 0 and length 1, float32; one that is constant becomes 0."""
    centred = vectors.double()  # in float32 the rounding of a mean would be taken for contrast
    centred = centred - centred.mean(1, keepdim=True)
    return (centred / (centred.square().sum(1, keepdim=True) + NO_CONTRAST).sqrt()).float()


def lasso(gram: Tensor, correlations: Tensor, sparsity: float) -> Tensor:
    """The codes α ≥ 0 that minimise ½‖x - Dα‖² + λ‖α‖₁, for many x at once.

    By coordinate descent, each code on a small set of atoms to which those are added that miss the conditions of the
    optimum most: of a thousand atoms a code uses a hundred or two.

    Args:
        gram: DᵀD of the atoms, (K, K), float32 on the CPU; an atom of length 0 is never used.
        correlations: Dᵀx, (N, K).
        sparsity: λ.

    Returns:
        (N, K), float32.  The derivative of the objective is within λ/100 of 0 where a code is positive, and above
        -λ/100 elsewhere.
    """
    codes = np.zeros(correlations.shape, np.float32)
    products, found = gram.contiguous().numpy(), correlations.contiguous().numpy()
    weight, exactness = np.float32(sparsity), np.float32(EXACTNESS * sparsity)

    def code(portion: int) -> None:
        part = slice(portion * PORTION, (portion + 1) * PORTION)
        _lasso(products, found[part], weight, exactness, MAX_ROUNDS, codes[part])

    in_threads(code, -(-len(codes) // PORTION))
    return torch.from_numpy(codes)


@compiled
def _lasso(gram: Any, correlations: Any, sparsity: Any, exactness: Any, max_rounds: int, codes: Any) -> None:
    """Writes the codes (N, K), given as zeros, for ``correlations`` (N, K)."""
    count, atoms = correlations.shape
    zero = sparsity * 0
    ascent = np.empty(atoms, correlations.dtype)  # minus the derivative
    members = np.empty(atoms, np.int64)  # of the set
    among = np.empty(atoms * atoms, correlations.dtype)  # their gram matrix, to have it all in cache
    of_members, values = np.empty(atoms, correlations.dtype), np.empty(atoms, correlations.dtype)
    for i in range(count):
        code = codes[i]
        for _ in range(max_rounds):
            for k in range(atoms):
                ascent[k] = correlations[i, k] - sparsity
            for k in range(atoms):
                value = code[k]
                if value > 0:
                    row = gram[k]
                    for m in range(atoms):
                        ascent[m] -= value * row[m]
            missed = zero
            for k in range(atoms):
                if gram[k, k] > 0:
                    missed = max(missed, abs(ascent[k]) if code[k] > 0 else ascent[k])
            if not missed > exactness:
                break
            size = 0
            for k in range(atoms):
                if gram[k, k] > 0 and (code[k] > 0 or 2 * ascent[k] > missed):
                    members[size] = k
                    size += 1
            for n in range(size):
                k = members[n]
                values[n], of_members[n] = code[k], ascent[k]
                row, wide = among[n * size : (n + 1) * size], gram[k]
                for m in range(size):
                    row[m] = wide[members[m]]
            enough = max(exactness, missed) / 4
            for _ in range(1000):
                largest = zero
                for n in range(size):
                    row = among[n * size : (n + 1) * size]
                    step = max(values[n] + of_members[n] / row[n], zero) - values[n]
                    if step != 0:
                        values[n] += step
                        for m in range(size):
                            of_members[m] -= step * row[m]
                        largest = max(largest, abs(step) * row[n])
                if not largest > enough:
                    break
            for n in range(size):
                code[members[n]] = max(values[n], zero)


def _weights(spec: HOGSpec) -> Tensor:
    """The Gaussian by which patches are multiplied, (height, width) of one, of sum 1."""
    sides = []
    for pixels, cell in zip(patch_size(spec), spec.cell_size, strict=True):
        place = torch.arange(pixels) - (pixels - 1) / 2
        side = torch.exp(-0.5 * (place / (SIGMA * cell)) ** 2)
        sides.append(side / side.sum())
    return torch.outer(*sides)


def _singles(name: str, array: NDArray[np.generic]) -> Tensor:
    if array.dtype != np.float32:
        raise ValueError(f"{name} must be float32, got {array.dtype}")
    return torch.from_numpy(array)
