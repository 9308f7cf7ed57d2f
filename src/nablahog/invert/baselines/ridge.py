"""Ridge regression: each patch of the image is a linear function of the window of the descriptor around it.

One of the baselines that Vondrick et al. compare HOGgles with (*HOGgles: Visualizing Object Detection Features*, ICCV
2013): the image that is most likely if descriptors and images are jointly Gaussian.  Theirs takes a whole detection
window at once; here it is a window of 7x7 cells around each cell, so that images of any size can be inverted, and the
mean of the patches that overlap at a pixel is its value.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...hog.spec import HOGSpec
from ...io.npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays
from ..preimage import Reconstruction, check_descriptor
from ..provenance import digest_of_images
from .windows import Pairs, check_images, mean_of_patches, patch_size, stretched, windows_at_cells, without_search

FORMAT = 1
CELLS = 7  # of the side of a window and of a patch
PENALTY = 0.01  # of the squares of the weights, in mean squares of an entry of a window
WINDOWS = 250_000
LARGEST = 1e6  # weight: those learned from photographs are below 10
_TOGETHER = 8  # descriptors whose patches are in memory at a time
_ARRAYS = ("format", "spec", "weights", "learning")


@dataclass(frozen=True)
class Learning:
    """How a regression was learned.

    Attributes:
        images: the names of the images, sorted.
        sha256: of the images, in this order, hexadecimal.
        windows: how many it was learned from.
        penalty: of the squares of the weights, in mean squares of an entry of a window.
        seed: of the choice of windows.
    """

    images: tuple[str, ...]
    sha256: str
    windows: int
    penalty: float
    seed: int


@dataclass(frozen=True, eq=False)
class RidgeRegression:
    """The weights by which a window makes a patch.

    Attributes:
        spec: the dialect that it was learned for.
        weights: (7 · 7 · channels + 1, 7 · cell height · 7 · cell width), float32; the last row is the constant.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or what no regression gives.
    """

    spec: HOGSpec
    weights: Tensor
    learning: Learning

    def __post_init__(self) -> None:
        shape = (CELLS * CELLS * self.spec.channels + 1, math.prod(patch_size(self.spec, CELLS)))
        got = self.weights
        if got.dtype != torch.float32 or got.shape != shape:
            raise ValueError(f"the weights must be float32 of shape {shape}, got {got.dtype} of {tuple(got.shape)}")
        if not (got.abs() <= LARGEST).all():  # NaN fails too
            raise ValueError(f"the weights must lie within ±{LARGEST:g}, got NaN, Inf or more")

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, "the regression")

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

        Each image is stretched so that its darkest pixel is 0 and its brightest 1; one without contrast is 0.5.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device; computed in float32 on the CPU.
            spec: its dialect, which must be the regression's.
            image_size: (height, width); by default whole cells.
            progress: called with the descriptors done and their number.

        Returns:
            No evaluation of the operator is spent, so the history is empty, (0, B).

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the regression's.
        """
        began = time.perf_counter()
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        count = len(descriptor)
        images = []
        for first in range(0, count, _TOGETHER):
            if progress:
                progress(first, count)
            windows = windows_at_cells(descriptor[first : first + _TOGETHER].float().cpu(), CELLS)
            patches = windows @ self.weights[:-1] + self.weights[-1]
            images.append(stretched(mean_of_patches(patches, spec, CELLS, size)))
        if progress:
            progress(count, count)
        return without_search(torch.cat(images), descriptor, spec, "windows are done", began)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is an .npz archive of the arrays ``format`` (1), ``spec`` (its JSON), ``weights`` and ``learning`` (JSON).

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {
            "spec": self.spec.to_json(),
            "weights": self.weights.numpy(),
            "learning": account_to_text(self.learning),
        }
        write_arrays(path, FORMAT, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> RidgeRegression:
        """The regression that :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
                arrays contradict each other.
        """
        arrays = read_arrays(path, "ridge regression", _ARRAYS)
        with naming(path):
            check_format(arrays, "ridge regression", FORMAT)
            weights = arrays["weights"]
            if weights.dtype != np.float32:
                raise ValueError(f"the weights must be float32, got {weights.dtype}")
            spec, learning = (text(arrays, name) for name in ("spec", "learning"))
            return cls(HOGSpec.from_json(spec), torch.from_numpy(weights), account_of(Learning, learning))


@torch.no_grad()
def learn_ridge(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    windows: int = WINDOWS,
    penalty: float = PENALTY,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> RidgeRegression:
    """Learns, from photographs, the linear function of a window that misses its patch least.

    It minimises Σ‖patch - (w·window + b)‖² + λ‖w‖² over all windows of 7x7 cells, also those at the border, beyond
    which descriptors are 0 and the images' outermost pixels are repeated.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect.
        windows: the most to learn from; if there are more, so many of them, at random.
        penalty: λ, in mean squares of an entry of all windows; above 0.
        seed: of everything random.
        progress: called with the images done, their number and what is being done.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; a number is out of range.
    """
    if windows < 1:
        raise ValueError(f"windows must be at least 1, got {windows}")
    if not 0 < penalty < math.inf:
        raise ValueError(f"penalty must be a finite number above 0, got {penalty}")
    names = check_images(images, spec)
    pairs = Pairs([images[name] for name in names], spec, CELLS, windows, np.random.default_rng(seed))
    entries = CELLS * CELLS * spec.channels + 1
    squares = torch.zeros(entries, entries, dtype=torch.float64)
    products = torch.zeros(entries, math.prod(patch_size(spec, CELLS)), dtype=torch.float64)
    for done, (some, patches) in enumerate(pairs):
        progress(done, len(names), names[done])
        with_one = torch.cat([some, torch.ones(len(some), 1)], dim=1).double()  # in float32, a small penalty drowns
        squares += with_one.T @ with_one
        products += with_one.T @ patches.double()
    progress(len(names), len(names), "solving for the weights")
    diagonal = squares.diagonal()
    diagonal[:-1] += penalty * max(float(diagonal[:-1].mean()), 1.0)  # flat images have no entry at all
    weights = torch.cholesky_solve(products, torch.linalg.cholesky(squares)).float()
    learning = Learning(tuple(names), digest_of_images(names, images), len(pairs), penalty, seed)
    return RidgeRegression(spec, weights, learning)
