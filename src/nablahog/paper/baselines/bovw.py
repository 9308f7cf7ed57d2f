"""BoVW: an image from the histogram of its visual words alone, as a jigsaw puzzle.

Kato and Harada, *Image Reconstruction from Bag-of-Visual-Words* (CVPR 2014): local descriptors on a regular grid of one
scale are quantised to visual words, and only the histogram of these words is known of an image.  A database of images
tells the cost of a word at a place and of two words as neighbours.  A heuristic finds an arrangement of low cost.  This
much is in the abstracts; the rest is ours:

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
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import fold

from ...invert.prior.provenance import Learning
from ...invert.reconstruction import Reconstruction
from ...io.learned_model import INTEGER, TENSOR, LearnedModel, account, check_tensor, integers
from ...runtime.text import counted
from .bovw_arrangement import Costs, arrange
from .dense_sift import LENGTH, WINDOW_CELLS, dense_sift, sift_grid

MAX_WORD_ENTRY = 1 + 1e-5  # entry of a word, whose length is at most 1, up to rounding
IMAGE_BATCH = 16  # images that are described or rendered at a time


@dataclass(frozen=True, kw_only=True)
class BoVWLearning(Learning):
    """How a vocabulary was learned: the number of words asked for, of windows clustered, and of rounds of k-means."""

    words: int
    windows: int
    rounds: int


@dataclass(frozen=True, eq=False, repr=False)
class BoVW(LearnedModel):
    """A codebook of visual words, a gray patch for each, and a database of their arrangements.

    Attributes:
        vocabulary: (K, 128), float32, a descriptor for each word.
        patches: (K, size, size), float32 in 0…1, a gray patch for each word, with the window in its middle.
        database: (N, rows, cols), int16, the words of images.
        image_size: (height, width) of all images.
        cell: of the descriptor, in pixels.
        learning: how it was learned.
    """

    KIND = "BoVW model"
    NOUN = "vocabulary"
    ARRAYS: ClassVar = {
        "vocabulary": TENSOR,
        "patches": TENSOR,
        "database": TENSOR,
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
        check_tensor("vocabulary", self.vocabulary, torch.float32, (words, LENGTH), 0, MAX_WORD_ENTRY)
        check_tensor("patches", self.patches, torch.float32, (words, size, size), 0, 1)
        check_tensor("database", self.database, torch.int16, (count, *grid), 0, words - 1)
        check_patch(size, self.cell)
        if len(torch.unique(self.database)) < words:
            raise ValueError("each word of the vocabulary must occur in the database")

    @property
    def summary(self) -> str:
        return f"{len(self.vocabulary)} words, {counted(len(self.learning.images), 'image')}"

    def words(self, image: Tensor) -> Tensor:
        """The nearest word of each window: images (B, 1, H, W) in 0…1 to (B, rows, cols).

        Raises:
            ValueError: the images have another size than those that the words were learned from.
        """
        if image.shape[1:] != (1, *self.image_size):
            expected, got = ("x".join(map(str, size)) for size in (self.image_size, image.shape[2:]))
            raise ValueError(f"the words were learned from images of {expected} pixels (height x width), got {got}")
        descriptors = (dense_sift(batch.float(), self.cell) for batch in torch.split(image, IMAGE_BATCH))
        return torch.cat([nearest_words(batch, self.vocabulary) for batch in descriptors])

    def histogram(self, image: Tensor) -> Tensor:
        """The histogram of the words of images (B, 1, H, W): (B, K), float32.  The descriptor that is inverted."""
        counts = [torch.bincount(words.flatten(), minlength=len(self.vocabulary)) for words in self.words(image)]
        return torch.stack(counts).float()

    def render(self, words: Tensor) -> Tensor:
        """Images (B, 1, H, W) in 0…1, float32, of the patches of words (B, rows, cols)."""
        size = self.patches.shape[-1]
        tent = 1 - ((torch.arange(size) + 0.5) * (2 / size) - 1).abs()
        weights = torch.outer(tent, tent)
        rows, cols = words.shape[1:]
        canvas = ((rows - 1) * self.cell + size, (cols - 1) * self.cell + size)
        ones = weights.reshape(1, -1, 1).expand(-1, -1, rows * cols)
        total_weight = fold(ones, canvas, size, stride=self.cell)
        weighted = (self.patches * weights).flatten(1)
        images = [
            fold(weighted[batch.flatten(1)].mT, canvas, size, stride=self.cell) / total_weight
            for batch in torch.split(words, IMAGE_BATCH)
        ]
        margin = (size - WINDOW_CELLS * self.cell) // 2
        down, across = (
            (torch.arange(side) + margin).clamp(max=end - 1) for side, end in zip(self.image_size, canvas, strict=True)
        )  # beyond the last whole cell the edge is repeated
        return torch.cat(images)[..., down[:, None], across].clamp(0, 1)

    @torch.no_grad()
    def reconstruct(self, histogram: Tensor, *, seed: int = 0) -> Reconstruction:
        """Images from histograms (B, K) of :meth:`histogram` alone.  Images of a batch do not depend on each other.

        Their distance is that of their own histogram.  The history is (sweeps + 1, B), float64: the cost of the
        arrangement before and after each sweep over all pairs of places.  Evaluations are sweeps.
        """
        began = time.perf_counter()
        target = histogram.double()
        words, histories, reasons = [], [], []
        for counts in target:
            to_place = np.repeat(np.arange(len(counts)), counts.long().numpy())
            location = self._costs.location(counts.numpy())
            arrangement, history, settled = arrange(to_place, location, self._costs, np.random.default_rng(seed))
            words.append(torch.from_numpy(arrangement))
            histories.append(history)
            reasons.append("no swap of two words lowers the cost" if settled else "all sweeps are used up")
        image = self.render(torch.stack(words))
        residual = (self.histogram(image).double() - target).norm(dim=1)
        longest = max(map(len, histories))
        costs = [history + [history[-1]] * (longest - len(history)) for history in histories]
        return Reconstruction(
            image,
            (residual / target.norm(dim=1)).to(histogram),
            reasons,
            torch.tensor(costs, dtype=torch.float64).T,
            torch.tensor([len(history) - 1 for history in histories]),
            time.perf_counter() - began,
        )

    @cached_property
    def _costs(self) -> Costs:
        return Costs(self.database.numpy().astype(np.int64), self.vocabulary.numpy().astype(np.float64))


def check_grid(image_size: tuple[int, int], cell: int) -> tuple[int, int]:
    """Rows and columns of the words of an image; ValueError if there are fewer than two words in all."""
    if cell < 1:
        raise ValueError(f"a cell must be at least 1 pixel wide, got {cell}")
    rows, cols = sift_grid(*image_size, cell)
    if rows * cols < 2:
        side = WINDOW_CELLS * cell
        raise ValueError(
            f"expected images of at least two windows of {side}x{side} pixels, {cell} apart, "
            f"got {image_size[0]}x{image_size[1]}"
        )
    return rows, cols


def check_patch(size: int, cell: int) -> None:
    """Raises ValueError unless a patch of ``size`` pixels has the window of 4x4 cells in its middle."""
    if size < WINDOW_CELLS * cell or (size - WINDOW_CELLS * cell) % 2:
        raise ValueError(f"a patch must be {WINDOW_CELLS * cell} pixels wide, or an even number more, got {size}")


def nearest_words(descriptors: Tensor, vocabulary: Tensor) -> Tensor:
    """The index (…) of the word (K, n) that is nearest to each descriptor (…, n)."""
    squared = vocabulary.square().sum(1)
    return (squared - 2 * descriptors @ vocabulary.T).argmin(dim=-1)
