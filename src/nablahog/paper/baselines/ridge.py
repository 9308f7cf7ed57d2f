"""Ridge regression: each patch of the image is a linear function of the window of the descriptor around it.

One of the baselines that Vondrick et al. compare HOGgles with (*HOGgles: Visualizing Object Detection Features*, ICCV
2013): the image that is most likely if descriptors and images are jointly Gaussian.  Theirs takes a whole detection
window at once; here it is a window of 7x7 cells around each cell, so that images of any size can be inverted, and
overlapping patches are averaged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from ...hog.spec import HOGSpec
from ...invert.provenance import Learning, digest_of_images
from ...io.learned_model import SPEC, account, check_tensor, tensor
from .window_model import WindowModel
from .windows import Pairs, average_patches, check_images, crop, patch_size, stretched, windows_at_cells

CELLS = 7  # of the side of a window and of a patch
PENALTY = 0.01  # λ, in mean squares of an entry of a window
WINDOWS = 250_000
LARGEST = 1e6  # weight: those learned from photographs are below 10
BATCH = 8  # descriptors whose patches are in memory at a time


@dataclass(frozen=True, kw_only=True)
class RidgeLearning(Learning):
    """How a regression was learned.

    Attributes:
        windows: how many it was learned from.
        penalty: λ, in mean squares of an entry of a window.
    """

    windows: int
    penalty: float


@dataclass(frozen=True, eq=False, repr=False)
class RidgeRegression(WindowModel):
    """The affine function from a window to a patch.

    Attributes:
        spec: the dialect that it was learned for.
        weights: (7 · 7 · channels + 1, 7 · cell height · 7 · cell width), float32; the last row is the constant.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or weights beyond ±1e6.
    """

    KIND = "ridge regression"
    NOUN = "regression"
    ARRAYS: ClassVar = {"spec": SPEC, "weights": tensor(np.float32), "learning": account(RidgeLearning)}

    spec: HOGSpec
    weights: Tensor
    learning: RidgeLearning

    def __post_init__(self) -> None:
        shape = (CELLS * CELLS * self.spec.channels + 1, math.prod(patch_size(self.spec, CELLS)))
        check_tensor("weights", self.weights, torch.float32, shape, -LARGEST, LARGEST)

    @property
    def summary(self) -> str:
        return f"{self.weights.numel():,} weights, {len(self.learning.images)} images"

    def _batch_size(self, rows: int, cols: int) -> int:
        return BATCH

    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        patches = windows_at_cells(descriptor, CELLS) @ self.weights[:-1] + self.weights[-1]
        return stretched(crop(average_patches(patches, self.spec, CELLS), self.spec, CELLS // 2, size))


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
    """Learns, from photographs, the linear function of a window that predicts its patch.

    It minimises Σ‖patch - (w·window + b)‖² + λ‖w‖² over all windows of 7x7 cells.  Beyond the border descriptors are 0,
    and the outermost pixels of images are repeated.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect.
        windows: the most to learn from; of more, so many are drawn at random.
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
    gram = torch.zeros(entries, entries, dtype=torch.float64)
    products = torch.zeros(entries, math.prod(patch_size(spec, CELLS)), dtype=torch.float64)
    for done, (x, patches) in enumerate(pairs):
        progress(done, len(names), names[done])
        with_one = torch.cat([x, torch.ones(len(x), 1)], dim=1).double()  # float32 would round a small penalty away
        gram += with_one.T @ with_one
        products += with_one.T @ patches.double()
    progress(len(names), len(names), "solving for the weights")
    diagonal = gram.diagonal()
    diagonal[:-1] += penalty * max(float(diagonal[:-1].mean()), 1.0)  # windows of flat images are all 0
    weights = torch.cholesky_solve(products, torch.linalg.cholesky(gram)).float()
    learning = RidgeLearning(
        images=tuple(names), sha256=digest_of_images(images), seed=seed, windows=len(pairs), penalty=penalty
    )
    return RidgeRegression(spec, weights, learning)
