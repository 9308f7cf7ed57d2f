"""BoVW: an image from the histogram of its visual words alone, as a jigsaw puzzle.

Kato and Harada, *Image Reconstruction from Bag-of-Visual-Words* (CVPR 2014): local descriptors on a regular grid of one
scale are quantised to visual words, and only the histogram of these words is known of an image.  A database of images
tells the cost of a word at a place and of two words as neighbours.  A heuristic finds an arrangement of low cost.
:func:`.bovw_learning.learn_bovw` makes the vocabulary and the database.

This much is in the abstracts.  The rest is ours:

* The descriptor is SIFT in windows of 4x4 cells of 8 pixels, one at each cell (:mod:`.dense_sift`).  Windows without
  contrast are one word.
* The costs are negative logarithms of smoothed frequencies.  A regression on the whole histogram predicts the places of
  a word; pairs are counted over the whole database (:mod:`.bovw_arrangement`).
* The search starts from the best arrangement by places alone, and swaps two words as long as that lowers the cost.
* The patch of a word is the mean of all patches of the database with this word, in absolute gray.  Overlapping patches
  are averaged with weights that fall towards the patch's border.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import fold

from ...invert.arguments import check_finite, check_floats
from ...invert.provenance import Learning
from ...invert.reconstruction import Reconstruction
from ...io.learned_model import INTEGER, LearnedModel, account, check_tensor, integers, tensor
from .bovw_arrangement import Costs, arrange
from .dense_sift import CELLS, LENGTH, dense_sift, sift_grid

LARGEST = 1 + 1e-5  # entry of a word, whose length is at most 1, up to rounding
BATCH = 16  # images that are described or rendered at a time


@dataclass(frozen=True, kw_only=True)
class BoVWLearning(Learning):
    """How a vocabulary was learned.  Each image counts twice, the second time mirrored.

    Attributes:
        words: the number asked for; words that no window belongs to are left out.
        windows: how many were clustered.
        rounds: of k-means.
    """

    words: int
    windows: int
    rounds: int


@dataclass(frozen=True, eq=False, repr=False)
class BoVW(LearnedModel):
    """A codebook of visual words, a gray patch for each, and a database of their arrangements.

    Attributes:
        vocabulary: (K, 128), float32, the codebook: a descriptor for each word.
        patches: (K, size, size), float32 in 0…1, a gray patch for each word, with the window in its middle.
        database: (N, rows, cols), int16, the words of images.
        image_size: (height, width) of all images.
        cell: of the descriptor, in pixels.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or values out of range.
    """

    KIND = "BoVW model"
    NOUN = "vocabulary"
    ARRAYS: ClassVar = {
        "vocabulary": tensor(np.float32),
        "patches": tensor(np.float32),
        "database": tensor(np.int16),
        "image_size": integers(2),
        "cell": INTEGER,
        "learning": account(BoVWLearning),
    }

    vocabulary: Tensor
    patches: Tensor
    database: Tensor
    image_size: tuple[int, int]
    cell: int
    learning: BoVWLearning

    def __post_init__(self) -> None:
        grid = check_grid(self.image_size, self.cell)
        words = len(self.vocabulary) if self.vocabulary.dim() else 0
        size = self.patches.shape[-1] if self.patches.dim() else 0
        count = len(self.database) if self.database.dim() else 0
        check_tensor("vocabulary", self.vocabulary, torch.float32, (words, LENGTH), 0, LARGEST)
        check_tensor("patches", self.patches, torch.float32, (words, size, size), 0, 1)
        check_tensor("database", self.database, torch.int16, (count, *grid), 0, words - 1)
        check_patch(size, self.cell)
        if len(torch.unique(self.database)) < words:
            raise ValueError("each word of the vocabulary must be somewhere in the database")

    @property
    def summary(self) -> str:
        return f"{len(self.vocabulary)} words, {len(self.learning.images)} images"

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the words of an image."""
        return sift_grid(*self.image_size, self.cell)

    def words(self, image: Tensor) -> Tensor:
        """The nearest word of each window: images (B, 1, H, W) in 0…1, float32 or float64, to (B, rows, cols).

        Raises:
            TypeError: the images are no tensor, or of another dtype.
            ValueError: their shape or size is another, or they hold NaN or other values.
        """
        check_floats("the images", image)
        expected = (1, *self.image_size)
        if image.dim() != 4 or image.shape[1:] != expected or not len(image):
            raise ValueError(f"the images must have shape {('B', *expected)}, B at least 1, got {tuple(image.shape)}")
        if not ((image >= 0) & (image <= 1)).all():
            raise ValueError("the images must lie in 0…1, got NaN or other values")
        vocabulary = self.vocabulary.to(image.device)
        descriptors = (dense_sift(batch.float(), self.cell) for batch in batches(image.detach()))
        return torch.cat([nearest_words(batch, vocabulary) for batch in descriptors])

    def histogram(self, image: Tensor) -> Tensor:
        """The histogram of the words of images (B, 1, H, W): (B, K), float32.  The descriptor that is inverted.

        Raises:
            TypeError, ValueError: as :meth:`words`.
        """
        words = self.words(image).flatten(1)
        counts = torch.zeros(len(words), len(self.vocabulary), device=words.device)
        return counts.scatter_add_(1, words, torch.ones_like(words, dtype=counts.dtype))

    def render(self, words: Tensor) -> Tensor:
        """Images (B, 1, H, W) in 0…1, float32, of the patches of words (B, rows, cols)."""
        size = self.patches.shape[-1]
        tent = 1 - ((torch.arange(size) + 0.5) * (2 / size) - 1).abs()
        weights = torch.outer(tent, tent)
        rows, cols = self.grid
        canvas = ((rows - 1) * self.cell + size, (cols - 1) * self.cell + size)
        ones = weights.reshape(1, -1, 1).expand(-1, -1, rows * cols)
        total_weight = fold(ones, canvas, size, stride=self.cell)
        weighted = (self.patches * weights).flatten(1)
        images = [
            fold(weighted[batch.cpu().flatten(1)].mT, canvas, size, stride=self.cell) / total_weight
            for batch in batches(words)
        ]
        margin = (size - CELLS * self.cell) // 2
        down, across = (
            (torch.arange(side) + margin).clamp(max=end - 1) for side, end in zip(self.image_size, canvas, strict=True)
        )  # beyond the last whole cell the edge is repeated
        return torch.cat(images)[..., down[:, None], across].clamp(0, 1).to(words.device)

    @torch.no_grad()
    def reconstruct(
        self,
        histogram: Tensor,
        image_size: tuple[int, int] | None = None,
        *,
        seed: int = 0,
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """Images from histograms of visual words alone.  Images of a batch do not depend on each other.

        Args:
            histogram: (B, K), float32 or float64, on any device: counts of :meth:`histogram`.  Computed on the CPU.
            image_size: (height, width), which must be the vocabulary's.
            seed: of the order in which swaps are tried, the same for every image of the batch.
            progress: called with the images done and their number.

        Returns:
            Images in 0…1; their distance is that of their own histogram.  The history is (sweeps + 1, B), float64: the
            cost of the arrangement before and after each sweep over all pairs of places.  Evaluations are sweeps.

        Raises:
            TypeError: the histogram is no float32 or float64 tensor.
            ValueError: its shape is another, it holds NaN, Inf or what is no count, or not one word for each place; the
                image size is not the vocabulary's.
        """
        began = time.perf_counter()
        self._check(histogram, image_size)
        target = histogram.detach().cpu().double()
        words, histories, reasons = [], [], []
        for done, counts in enumerate(target):
            if progress:
                progress(done, len(target))
            to_place = np.repeat(np.arange(len(counts)), counts.long().numpy())
            location = self._costs.location(counts.numpy())
            arrangement, history, settled = arrange(to_place, location, self._costs, np.random.default_rng(seed))
            words.append(torch.from_numpy(arrangement))
            histories.append(history)
            reasons.append("no swap of two words lowers the cost" if settled else "all sweeps are used up")
        if progress:
            progress(len(target), len(target))
        image = self.render(torch.stack(words))
        residual = (self.histogram(image).double() - target).norm(dim=1)
        longest = max(map(len, histories))
        costs = [history + [history[-1]] * (longest - len(history)) for history in histories]
        return Reconstruction(
            image.to(histogram),
            (residual / target.norm(dim=1)).to(histogram),
            reasons,
            torch.tensor(costs, dtype=torch.float64, device=histogram.device).T,
            torch.tensor([len(history) - 1 for history in histories], device=histogram.device),
            time.perf_counter() - began,
        )

    @cached_property
    def _costs(self) -> Costs:
        return Costs(self.database.numpy().astype(np.int64), self.vocabulary.numpy().astype(np.float64))

    def _check(self, histogram: Tensor, image_size: tuple[int, int] | None) -> None:
        check_floats("the histogram", histogram)
        words, places = len(self.vocabulary), self.grid[0] * self.grid[1]
        if histogram.dim() != 2 or histogram.shape[1] != words or not len(histogram):
            raise ValueError(f"the histogram must have shape (B, {words}), B at least 1, got {tuple(histogram.shape)}")
        if image_size is not None and tuple(image_size) != self.image_size:
            raise ValueError(
                f"the words were learned from images of {self.image_size[0]}x{self.image_size[1]} pixels "
                f"(height x width), and cannot make one of {image_size[0]}x{image_size[1]}"
            )
        check_finite("the histogram", histogram)
        if not ((histogram >= 0) & (histogram == histogram.round())).all():
            raise ValueError("the histogram must hold counts, whole numbers of at least 0")
        wrong = histogram.sum(1) != places
        if wrong.any():
            counted = float(histogram.sum(1)[wrong][0])
            raise ValueError(f"the histogram must count one word for each of the {places} places, got {counted:g}")


def check_grid(image_size: tuple[int, int], cell: int) -> tuple[int, int]:
    """Rows and columns of the words of an image, at least two words in all.

    Raises:
        ValueError: cell and image size make fewer.
    """
    if cell < 1:
        raise ValueError(f"a cell must have at least 1 pixel, got {cell}")
    rows, cols = sift_grid(*image_size, cell)
    if rows * cols < 2:
        raise ValueError(
            f"expected images of at least two windows of {CELLS * cell}x{CELLS * cell} pixels, {cell} apart, "
            f"got {image_size[0]}x{image_size[1]}"
        )
    return rows, cols


def check_patch(size: int, cell: int) -> None:
    """Raises ValueError unless a patch of ``size`` pixels has the window of 4x4 cells in its middle."""
    if size < CELLS * cell or (size - CELLS * cell) % 2:
        raise ValueError(f"a patch must be {CELLS * cell} pixels wide, or an even number more, got {size}")


def batches(tensor: Tensor) -> tuple[Tensor, ...]:
    """Its rows, a few at a time."""
    return torch.split(tensor, BATCH)


def nearest_words(descriptors: Tensor, vocabulary: Tensor) -> Tensor:
    """The index (…) of the word (K, n) that is nearest to each descriptor (…, n)."""
    squared = vocabulary.square().sum(1)
    return (squared - 2 * descriptors @ vocabulary.T).argmin(dim=-1)
