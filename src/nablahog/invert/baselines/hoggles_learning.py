"""Learning the paired dictionaries of HOGgles from photographs.

A gray patch and the window of its descriptor, each of mean 0 and length 1, are one vector; one dictionary of such
vectors is learned and then cut in two.  It is learned online, as Mairal, Bach, Ponce and Sapiro describe it (*Online
Dictionary Learning for Sparse Coding*, ICML 2009) and as the published code has it done by SPAMS: batch after batch is
coded, the sums AᵀA and AᵀX of the codes A and windows X are carried on with less and less weight on the past, and each
atom in turn takes its best value for them, of length 1 at most.

Two things differ from the published code, which never sees the last window of a row and of a column of an image, and
which starts every hundred batches with the same windows again, so that it learns from 40,000 of a million.

Libraries have the same steps.  The positive lasso of scikit-learn's ``MiniBatchDictionaryLearning`` takes some fifty
milliseconds for a window here, six hours for a thousand batches of 400; SPAMS is under the GPL.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...hog.descriptor import hog
from ...hog.spec import HOGSpec
from ...io.npz import text
from ..checkpoint import Checkpoint
from ..provenance import digest_of_images
from .hoggles import AROUND, CELLS, Learning, PairedDictionary, check_sparsity, lasso, patch_size, unit
from .windows import check_cells

ATOMS = 1024
SPARSITY = 0.02
ITERATIONS = 1000
BATCH = 400  # windows
WINDOWS = 1_000_000
UNUSED = 1e-6  # mean square of an atom's weights below which it does not count as used
PATIENCE = 25  # iterations before an atom that is not used gives way to a window
BLOCK = 64  # atoms that are updated between two products of large matrices
REPORTED = 100  # iterations whose objectives make one mean


def learn_hoggles(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    atoms: int = ATOMS,
    sparsity: float = SPARSITY,
    iterations: int = ITERATIONS,
    windows: int = WINDOWS,
    fast: bool = False,
    seed: int = 0,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> PairedDictionary:
    """Learns, from photographs, what windows of HOG look like.  The published numbers are the defaults.

    Windows of 5x5 cells are taken at every cell whose patch of 7x7 cells lies in the image.  Only images, descriptors
    and a batch are in memory; windows are cut out when their batch comes.

    The result depends on the images, the spec, the numbers and the seed, and on nothing else as long as PyTorch, its
    number of threads and the processor stay the same; where they do not, on rounding, which a thousand iterations
    amplify.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect.
        atoms: K, of each dictionary.
        sparsity: λ of ½‖x - Dα‖² + λ‖α‖₁, in learning as in inversion.
        iterations: batches of 400 windows, in an order of which every window is part once before one comes again.
        windows: the most to learn from; if there are more, so many of them, at random.
        fast: whether random windows are the atoms, and nothing is learned.
        seed: of everything random.
        checkpoint: a file to keep what is learned in, after every hundred iterations.  If there is one, of the same
            learning, that learning goes on, with the same result.  It stays behind.
        progress: called with the iterations done, their number and how the learning stands.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; they have fewer windows with any
            contrast than there are to be atoms; a number is out of range; the spec has no row of channels for each cell
            (:func:`.windows.check_cells`); the checkpoint is of another learning, or
            damaged.
        OSError: the checkpoint cannot be written.
    """
    for name, number in (("atoms", atoms), ("iterations", iterations), ("windows", windows)):
        if number < 1:
            raise ValueError(f"{name} must be at least 1, got {number}")
    check_sparsity(sparsity)
    check_cells(spec)
    names = sorted(images)
    for name in names:
        _check(name, images[name], spec)
    if not names:
        raise ValueError("expected images to learn from, got none")
    rng = np.random.default_rng(seed)
    digest = digest_of_images(names, images)
    progress(0, iterations, "describing the images")
    pairs = _Pairs([images[name] for name in names], spec, windows, rng)
    dictionary = pairs.with_contrast(atoms, rng)
    objective: list[float] = []
    if not fast:
        learner = Learner(dictionary / math.sqrt(2), sparsity, rng)
        identity = {
            "images": digest,
            "spec": spec.to_json(),
            "atoms": atoms,
            "sparsity": sparsity,
            "iterations": iterations,
            "windows": windows,
            "seed": seed,
        }
        kept = Checkpoint(checkpoint, "dictionary pair", identity, ("objective", *learner.state()))
        objective = learner.restore(kept)
        if learner.batches > iterations:
            raise kept.damaged()
        recent: list[float] = []
        for done in range(learner.batches, iterations):
            progress(done, iterations, f"objective {objective[-1]:.4f}" if objective else "")
            recent.append(learner.learn(pairs.batch(done)))
            if len(recent) == REPORTED or done + 1 == iterations:
                objective.append(sum(recent) / len(recent))
                recent = []
                kept.save({"objective": objective, **learner.state()})
        dictionary = learner.atoms
    progress(iterations, iterations, f"objective {objective[-1]:.4f}" if objective else "")
    pixels = math.prod(patch_size(spec))
    batch, done = min(BATCH, len(pairs)), 0 if fast else iterations
    learning = Learning(tuple(names), digest, len(pairs), done, batch, seed, tuple(objective))
    return PairedDictionary(
        spec,
        dictionary[:, :pixels].reshape(atoms, *patch_size(spec)),
        dictionary[:, pixels:].reshape(atoms, CELLS, CELLS, spec.channels),
        sparsity,
        learning,
    )


class Learner:
    """A dictionary that gets better with every batch.

    Args:
        atoms: to begin with, (K, n), float32, each of length 1.
        sparsity: λ.
        rng: decides which windows replace atoms that are not used.

    Attributes:
        atoms: (K, n), each of length 1 at most.
    """

    def __init__(self, atoms: Tensor, sparsity: float, rng: np.random.Generator) -> None:
        self.atoms = atoms.clone()
        self.sparsity = sparsity
        self.rng = rng
        self.batches = 0
        self._codes = atoms.new_zeros(len(atoms), len(atoms))  # AᵀA, by window
        self._products = torch.zeros_like(atoms)  # AᵀX

    def learn(self, windows: Tensor) -> float:
        """One iteration, with ``windows`` (N, n).  Returns their mean ½‖x - Dα‖² + λ‖α‖₁ before it."""
        codes = lasso(self.atoms @ self.atoms.T, windows @ self.atoms.T, self.sparsity)
        residual = windows - codes @ self.atoms
        objective = float(residual.square().sum() / 2 + self.sparsity * codes.sum()) / len(windows)
        past = self._past(len(windows))
        self._codes.mul_(past).addmm_(codes.T, codes, alpha=1 / len(windows))
        self._products.mul_(past).addmm_(codes.T, windows, alpha=1 / len(windows))
        self.batches += 1
        self._update(windows)
        return objective

    def state(self) -> dict[str, Any]:
        """All that changes with a batch, as arrays by name."""
        return {
            "batches": np.array(self.batches),
            "dictionary": self.atoms.numpy(),
            "codes": self._codes.numpy(),
            "products": self._products.numpy(),
            "random": np.array(json.dumps(self.rng.bit_generator.state)),
        }

    def restore(self, checkpoint: Checkpoint) -> list[float]:
        """Brings it to the state that is kept, if one is, and gives the objectives kept beside it."""
        arrays = checkpoint.restore()
        if arrays is None:
            return []
        for name, now in self.state().items():
            array = arrays[name]
            if array.dtype.kind != now.dtype.kind or array.shape != now.shape:
                raise checkpoint.damaged()
            if array.dtype.kind == "f" and not np.isfinite(array.astype(np.float32)).all():
                raise checkpoint.damaged()
        self.batches = int(arrays["batches"].item())
        self.atoms, self._codes, self._products = (
            torch.from_numpy(arrays[name].astype(np.float32)) for name in ("dictionary", "codes", "products")
        )
        try:
            self.rng.bit_generator.state = json.loads(text(arrays, "random"))
            objective = [float(each) for each in arrays["objective"].astype(np.float64)]
        except (KeyError, OverflowError, RecursionError, TypeError, ValueError):
            raise checkpoint.damaged() from None
        if self.batches < 1 or not np.isfinite(objective).all():
            raise checkpoint.damaged()
        return objective

    def _past(self, size: int) -> float:
        """By what the sums over earlier batches are multiplied: those were coded with worse atoms."""
        seen = self.batches * size if self.batches < size else size * size + self.batches - size
        return (seen + 1 - size) / (seen + 1) if seen >= size else 0.0

    def _update(self, windows: Tensor) -> None:
        """Each atom in turn to its best value, the others being given: block coordinate descent.

        Blocks only make products of large matrices of it: within one, what has already changed is added.
        """
        used = self._codes.diagonal() > UNUSED
        for first in range(0, len(self.atoms), BLOCK):
            block = slice(first, min(first + BLOCK, len(self.atoms)))
            missing = self._products[block] - self._codes[block] @ self.atoms
            changes = torch.zeros_like(missing)
            for k in range(block.stop - first):
                atom = first + k
                if not used[atom]:
                    continue
                step = missing[k] - self._codes[atom, first:atom] @ changes[:k]
                found = self.atoms[atom] + step / self._codes[atom, atom]
                found /= found.norm().clamp(min=1)
                changes[k] = found - self.atoms[atom]
                self.atoms[atom] = found
        unused = (~used).nonzero()[:, 0]
        if self.batches >= PATIENCE and len(unused):
            chosen = windows[torch.from_numpy(self.rng.integers(len(windows), size=len(unused)))]
            self.atoms[unused] = chosen / chosen.norm(dim=1, keepdim=True).clamp(min=1)


class _Pairs:
    """The windows of images with their patches, cut out on demand, in a random order.

    Args:
        images: (H, W) each.
        spec: the dialect.
        most: windows, at random if there are more.
        rng: decides their order.
    """

    def __init__(self, images: Sequence[Tensor], spec: HOGSpec, most: int, rng: np.random.Generator) -> None:
        self.images, self.spec = images, spec
        self.descriptors = [hog(image[None, None], spec) for image in images]
        self.grids = [_grid(image, spec) for image in images]
        self.ends = np.cumsum([rows * cols for rows, cols in self.grids])
        self.order = rng.permutation(self.ends[-1])[:most]

    def __len__(self) -> int:
        return len(self.order)

    def batch(self, number: int) -> Tensor:
        """The windows of the batch ``number``, (N, n): patch and descriptor, each of length 1."""
        size = min(BATCH, len(self))
        return self._cut(self.order[np.arange(number * size, (number + 1) * size) % len(self)])

    def with_contrast(self, count: int, rng: np.random.Generator) -> Tensor:
        """The first windows whose both halves are not flat, (count, n)."""
        chosen: list[Tensor] = []
        missing = count
        for first in range(0, len(self), BATCH):
            pairs = self._cut(self.order[first : first + BATCH])
            chosen.append(pairs[pairs.square().sum(1) > 1.99][:missing])
            missing -= len(chosen[-1])
            if not missing:
                return torch.cat(chosen)
        raise ValueError(
            f"expected images with at least {count} windows of {CELLS}x{CELLS} cells, got {len(self)}, "
            f"{count - missing} of them not flat"
        )

    def _cut(self, numbers: NDArray[np.int64]) -> Tensor:
        """Windows by their numbers: those of the first image come first, row by row."""
        cell, (height, width) = self.spec.cell_size, patch_size(self.spec)
        patches, windows = [], []
        for number in numbers.tolist():
            which = int(np.searchsorted(self.ends, number, side="right"))
            rows, cols = self.grids[which]
            row, col = divmod(number - int(self.ends[which]) + rows * cols, cols)
            y, x = row * cell[0], col * cell[1]
            patches.append(self.images[which][y : y + height, x : x + width].flatten())
            y, x = row + AROUND, col + AROUND
            windows.append(self.descriptors[which][0, y : y + CELLS, x : x + CELLS].flatten())
        return torch.cat([unit(torch.stack(patches)), unit(torch.stack(windows))], dim=1)


def _grid(image: Tensor, spec: HOGSpec) -> tuple[int, int]:
    """Rows and columns of the windows whose patch lies in an image."""
    height, width = image.shape
    grid = spec.grid(height, width)
    rows, cols = (
        min(pixels // cell, cells) - CELLS - 2 * AROUND + 1
        for pixels, cell, cells in zip((height, width), spec.cell_size, grid, strict=True)
    )
    return rows, cols


def _check(name: str, image: Tensor, spec: HOGSpec) -> None:
    if image.dim() != 2 or image.dtype != torch.float32:
        raise ValueError(f"{name}: expected an image (H, W) of float32 in 0…1")
    least = patch_size(spec)
    if image.shape[0] < least[0] or image.shape[1] < least[1]:
        raise ValueError(
            f"{name}: expected at least {least[0]}x{least[1]} pixels, got {image.shape[0]}x{image.shape[1]}"
        )
    if not (image.min() >= 0 and image.max() <= 1):
        raise ValueError(f"{name}: expected an image (H, W) of float32 in 0…1")
