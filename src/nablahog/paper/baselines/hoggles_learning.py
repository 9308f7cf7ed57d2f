"""Learning the paired dictionaries of HOGgles from photographs.

A gray patch and the window of its descriptor, each of mean 0 and length 1, are concatenated.  One dictionary of such
vectors is learned and then cut in two.  It is learned online, batch by batch, by scikit-learn's
``MiniBatchDictionaryLearning`` (Mairal, Bach, Ponce and Sapiro, *Online Dictionary Learning for Sparse Coding*, ICML
2009), where the published code uses SPAMS.

In two more things this differs from the published code, which never sees the last window of a row or a column of an
image, and every hundred batches starts with the same windows again, so that it learns from 40,000 of a million.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...hog.descriptor import hog
from ...hog.spec import HOGSpec
from ...inputs.training_images import digest_of_images, gray_photographs
from ...io.checkpoint import Checkpoint
from ...runtime.extras import extra
from .hoggles import (
    MARGIN_CELLS,
    PATCH_CELLS,
    WINDOW_CELLS,
    HogglesLearning,
    PairedDictionary,
    check_cells,
    check_sparsity,
    patch_size,
    positive_lasso,
    unit,
)

ATOMS = 1024
SPARSITY = 0.02
LEARNING_STEPS = 1000
STEP_WINDOWS = 400  # windows
TRAINING_WINDOWS = 1_000_000
SWEEPS = 10  # of coordinate descent for the codes of a batch; with 1,000 the objective is as low
REPORTED = 100  # iterations between two reports of the objective
SAVED = 20  # iterations between two checkpoints


def learn_hoggles(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    atoms: int = ATOMS,
    sparsity: float = SPARSITY,
    iterations: int = LEARNING_STEPS,
    fast: bool = False,
    seed: int = 0,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> PairedDictionary:
    """Learns a pair of dictionaries from photographs.  The published numbers are the defaults.

    Windows of 5x5 cells are taken at every cell whose patch of 7x7 cells lies in the image.  Images, descriptors and
    one batch are in memory; the windows of a batch are cut out when it is needed.

    On another processor, or with another number of threads, the result also depends on rounding, which a thousand
    iterations amplify.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect.
        atoms: K, of each dictionary.
        sparsity: λ of ½‖x - Dα‖² + λ‖α‖₁, in learning as in inversion.
        iterations: batches of 400 windows; all windows come once before one comes again.
        fast: whether the atoms are random windows, and no dictionary is learned.
        seed: the seed of all random numbers.
        checkpoint: a file that is written every 20 iterations.  If it exists and is of the same learning, this is
            resumed, with the same result.  The file is not removed.
        progress: called with the iterations done, their number and the last objective.

    Raises:
        ValueError: images, numbers or the spec (:func:`.check_cells`) are not as above; fewer windows than atoms have
            contrast; scikit-learn is not installed; the checkpoint is damaged or of another learning.
        OSError: the checkpoint cannot be read or written.
    """
    for name, number in (("atoms", atoms), ("iterations", iterations)):
        if number < 1:
            raise ValueError(f"{name} must be at least 1, got {number}")
    check_sparsity(sparsity)
    check_cells(spec)
    photographs = gray_photographs(images, patch_size(spec))
    rng = np.random.default_rng(seed)
    progress(0, iterations, "describing the images")
    pairs = _Pairs([*photographs.values()], spec, rng)
    dictionary = pairs.draw_contrasted(atoms, rng)
    digest = digest_of_images(photographs)
    objective: list[float] = []
    if not fast:
        identity = {
            "images": digest,
            "spec": spec.to_json(),
            "atoms": atoms,
            "sparsity": sparsity,
            "iterations": iterations,
            "seed": seed,
        }
        learner = _learner(dictionary / math.sqrt(2), sparsity, rng)
        dictionary, objective = _improve(learner, pairs, Checkpoint(checkpoint, identity), progress)
    progress(iterations, iterations, f"objective {objective[-1]:.4f}" if objective else "")
    pixels = math.prod(patch_size(spec))
    learning = HogglesLearning(
        images=tuple(photographs),
        sha256=digest,
        seed=seed,
        windows=len(pairs),
        iterations=0 if fast else iterations,
        batch=min(STEP_WINDOWS, len(pairs)),
        objective=tuple(objective),
    )
    return PairedDictionary(
        spec,
        dictionary[:, :pixels].reshape(atoms, *patch_size(spec)),
        dictionary[:, pixels:].reshape(atoms, WINDOW_CELLS, WINDOW_CELLS, spec.channels),
        sparsity,
        learning,
    )


def _learner(atoms: Tensor, sparsity: float, rng: np.random.Generator) -> Any:
    """Online learning with positive codes that begins with ``atoms`` (K, n), each of length 1 at most."""
    with extra("sklearn", "HOGgles"):
        from sklearn.decomposition import MiniBatchDictionaryLearning
    return MiniBatchDictionaryLearning(
        len(atoms),
        alpha=sparsity,
        batch_size=STEP_WINDOWS,
        fit_algorithm="cd",
        transform_max_iter=SWEEPS,
        dict_init=atoms.numpy(),
        positive_code=True,
        random_state=int(rng.integers(2**31)),
    )


def _improve(
    learner: Any, pairs: _Pairs, checkpoint: Checkpoint, progress: Callable[[int, int, str], None]
) -> tuple[Tensor, list[float]]:
    """The dictionary (K, n) after all iterations, and the objective before every hundredth."""
    iterations = checkpoint.identity["iterations"]
    dictionary, objective = torch.from_numpy(learner.dict_init), list[float]()

    def restore(state: Mapping[str, Any]) -> None:
        _restore(learner, state["learner"])
        objective.extend(state["objective"])

    checkpoint.resume(restore)
    for done in range(getattr(learner, "n_steps_", 0), iterations):
        progress(done, iterations, f"objective {objective[-1]:.4f}" if objective else "")
        batch = pairs.batch(done)
        if done % REPORTED == 0:
            objective.append(_objective(dictionary, batch, learner.alpha))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a few codes of a batch need not converge
            learner.partial_fit(batch.numpy())
        dictionary = torch.from_numpy(learner.components_)
        if (done + 1) % SAVED == 0:
            checkpoint.save({"learner": _state(learner), "objective": objective})
    return dictionary, objective


def _state(learner: Any) -> dict[str, Any]:
    """All that a learner has learned, as tensors, texts, numbers and the state of its random numbers."""
    state = {name: value for name, value in vars(learner).items() if name not in learner.get_params()}
    for name, value in state.items():
        if isinstance(value, np.ndarray):
            state[name] = torch.from_numpy(value)
        elif isinstance(value, np.random.RandomState):
            kind, key, *rest = value.get_state()
            state[name] = (kind, np.asarray(key).tolist(), *rest)
    return state


def _restore(learner: Any, state: Mapping[str, Any]) -> None:
    """Undoes :func:`_state`."""
    for name, value in state.items():
        if isinstance(value, Tensor):
            value = value.numpy()
        elif isinstance(value, tuple):
            generator: Any = np.random.RandomState()
            generator.set_state(value)
            value = generator
        setattr(learner, name, value)


def _objective(atoms: Tensor, windows: Tensor, sparsity: float) -> float:
    """The mean of ½‖x - Dα‖² + λ‖α‖₁ over windows (N, n)."""
    codes = positive_lasso(atoms, windows, sparsity)
    residual = windows - codes @ atoms
    return float(residual.square().sum() / 2 + sparsity * codes.sum()) / len(windows)


class _Pairs:
    """The windows of images (H, W) with their patches, in a random order, a million at most, cut out when needed."""

    def __init__(self, images: Sequence[Tensor], spec: HOGSpec, rng: np.random.Generator) -> None:
        self.images, self.spec = images, spec
        self.descriptors = [hog(image[None, None], spec) for image in images]
        self.grids = [self._grid(image) for image in images]
        self.ends = np.cumsum([rows * cols for rows, cols in self.grids])
        self.order = rng.permutation(self.ends[-1])[:TRAINING_WINDOWS]

    def __len__(self) -> int:
        return len(self.order)

    def _grid(self, image: Tensor) -> tuple[int, int]:
        """Rows and columns of the windows whose patch lies in an image."""
        sides = zip(image.shape, self.spec.cell_size, self.spec.grid(*image.shape), strict=True)
        rows, cols = (min(pixels // cell, cells) - PATCH_CELLS + 1 for pixels, cell, cells in sides)
        return rows, cols

    def batch(self, number: int) -> Tensor:
        """The windows of the batch ``number``, (N, n): patch and descriptor, each of length 1."""
        size = min(STEP_WINDOWS, len(self))
        return self._cut_windows(self.order[np.arange(number * size, (number + 1) * size) % len(self)])

    def draw_contrasted(self, count: int, rng: np.random.Generator) -> Tensor:
        """The first windows whose patch and descriptor are not flat, (count, n)."""
        chosen: list[Tensor] = []
        missing = count
        for first in range(0, len(self), STEP_WINDOWS):
            pairs = self._cut_windows(self.order[first : first + STEP_WINDOWS])
            chosen.append(pairs[pairs.square().sum(1) > 1.99][:missing])  # of two halves of length 1 or 0
            missing -= len(chosen[-1])
            if not missing:
                return torch.cat(chosen)
        raise ValueError(
            f"expected images with at least {count} windows of {WINDOW_CELLS}x{WINDOW_CELLS} cells that are not flat, "
            f"got {count - missing} of {len(self)}"
        )

    def _cut_windows(self, numbers: NDArray[np.int64]) -> Tensor:
        """Windows by their indices; the first image comes first, row by row."""
        cell, (height, width) = self.spec.cell_size, patch_size(self.spec)
        patches, windows = [], []
        for number in numbers.tolist():
            which = int(np.searchsorted(self.ends, number, side="right"))
            rows, cols = self.grids[which]
            row, col = divmod(number - int(self.ends[which]) + rows * cols, cols)
            y, x = row * cell[0], col * cell[1]
            patches.append(self.images[which][y : y + height, x : x + width].flatten())
            y, x = row + MARGIN_CELLS, col + MARGIN_CELLS
            windows.append(self.descriptors[which][0, y : y + WINDOW_CELLS, x : x + WINDOW_CELLS].flatten())
        return torch.cat([unit(torch.stack(patches)), unit(torch.stack(windows))], dim=1)
