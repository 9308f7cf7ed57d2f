"""BoVW: an image from the histogram of its visual words alone, as a jigsaw puzzle.

Kato and Harada, *Image Reconstruction from Bag-of-Visual-Words* (CVPR 2014): local descriptors on a regular grid of one
scale are quantised to visual words, and all that is known of an image is how often it has each word.  Where they go is
found by two costs, of a word at a place and of two words as neighbours, which are estimated from a database of images;
as an exact minimum is out of reach, by a heuristic.  :func:`.bovw_learning.learn_bovw` makes the database.

We know this much from the abstracts.  The rest is ours:

* The descriptor is SIFT in windows of 4x4 cells of 8 pixels, one at each cell (:mod:`.dense_sift`).  All windows
  without contrast are one word.
* The costs are negative logarithms of smoothed frequencies; the place of a word is predicted by a regression on the
  whole histogram, the pairs count over the whole database (:mod:`.bovw_arrangement`).
* The search starts from the best arrangement by places alone, and swaps words as long as that lowers the cost.
* A word looks like the mean, in absolute gray, of all patches of the database that are this word.  Overlapping patches
  are averaged, each pixel weighed by its distance to the patch's border.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import fold

from ...io.npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays
from ..preimage import Reconstruction
from .bovw_arrangement import Costs, arrange
from .dense_sift import CELLS, LENGTH, dense_sift, sift_grid

FORMAT = 1
LONGEST = 1 + 1e-5  # of a word, up to rounding
_TOGETHER = 16  # images whose patches, or whose descriptors' distances to all words, are in memory at a time
_ARRAYS = ("format", "vocabulary", "patches", "database", "image_size", "cell", "learning")


@dataclass(frozen=True)
class Learning:
    """How a vocabulary was learned.

    Attributes:
        images: the names of the images, sorted; each counts twice, the second time mirrored.
        sha256: of the images, in this order, hexadecimal.
        words: how many were asked for; those that no window belonged to are left out.
        windows: how many were clustered.
        rounds: of k-means.
        seed: of everything random.
    """

    images: tuple[str, ...]
    sha256: str
    words: int
    windows: int
    rounds: int
    seed: int


@dataclass(frozen=True, eq=False)
class BoVW:
    """Visual words, what they look like, and a database of their arrangements.

    Attributes:
        vocabulary: (K, 128), float32, the words as descriptors.
        patches: (K, size, size), float32 in 0…1, the words as pictures, each with the window in its middle.
        database: (N, rows, cols), int16, the words of images.
        image_size: (height, width) of all images.
        cell: of the descriptor, in pixels.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other, or hold NaN, Inf or what no descriptor or picture holds.
    """

    vocabulary: Tensor
    patches: Tensor
    database: Tensor
    image_size: tuple[int, int]
    cell: int
    learning: Learning

    def __post_init__(self) -> None:
        grid = check_grid(self.image_size, self.cell)
        words = len(self.vocabulary) if self.vocabulary.dim() else 0
        size = self.patches.shape[-1] if self.patches.dim() else 0
        count = len(self.database) if self.database.dim() else 0
        expected: dict[str, tuple[torch.dtype, tuple[int, ...], float]] = {
            "vocabulary": (torch.float32, (words, LENGTH), LONGEST),
            "patches": (torch.float32, (words, size, size), 1),
            "database": (torch.int16, (count, *grid), words - 1),
        }
        for name, (dtype, shape, largest) in expected.items():
            array: Tensor = getattr(self, name)
            if array.dtype != dtype or array.shape != shape or not array.numel():
                raise ValueError(f"the {name} must be {dtype} of shape {shape}, got {array.dtype} of {(*array.shape,)}")
            if not ((array >= 0) & (array <= largest)).all():  # NaN fails too
                raise ValueError(f"the {name} must lie in 0…{largest:.0f}, got NaN, Inf or other values")
        check_patch(size, self.cell)
        if len(torch.unique(self.database)) < words:
            raise ValueError("each word of the vocabulary must be somewhere in the database")

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the words of an image."""
        return sift_grid(*self.image_size, self.cell)

    def words(self, image: Tensor) -> Tensor:
        """The word of each window: images (B, 1, H, W) in 0…1, float32 or float64, to (B, rows, cols).

        Raises:
            TypeError: the images are no tensor, or of another dtype.
            ValueError: their shape or size is another, or they hold NaN or other values.
        """
        if not isinstance(image, Tensor) or image.dtype not in (torch.float32, torch.float64):
            got = image.dtype if isinstance(image, Tensor) else type(image).__name__
            raise TypeError(f"the images must be a float32 or float64 tensor, got {got}")
        expected = (1, *self.image_size)
        if image.dim() != 4 or image.shape[1:] != expected or not len(image):
            raise ValueError(f"the images must have shape {('B', *expected)}, B at least 1, got {tuple(image.shape)}")
        if not ((image >= 0) & (image <= 1)).all():
            raise ValueError("the images must lie in 0…1, got NaN or other values")
        vocabulary = self.vocabulary.to(image.device)
        return torch.cat(
            [nearest(dense_sift(some.float(), self.cell), vocabulary) for some in portions(image.detach())]
        )

    def histogram(self, image: Tensor) -> Tensor:
        """How often each word is in images (B, 1, H, W): (B, K), float32.  The descriptor that is inverted.

        Raises:
            TypeError, ValueError: as :meth:`words`.
        """
        words = self.words(image).flatten(1)
        counts = torch.zeros(len(words), len(self.vocabulary), device=words.device)
        return counts.scatter_add_(1, words, torch.ones_like(words, dtype=counts.dtype))

    def picture(self, words: Tensor) -> Tensor:
        """What words (B, rows, cols) look like: (B, 1, H, W) in 0…1, float32."""
        size = self.patches.shape[-1]
        tent = 1 - ((torch.arange(size) + 0.5) * (2 / size) - 1).abs()
        weights = torch.outer(tent, tent)
        rows, cols = self.grid
        canvas = ((rows - 1) * self.cell + size, (cols - 1) * self.cell + size)
        ones = weights.reshape(1, -1, 1).expand(-1, -1, rows * cols)
        covered = fold(ones, canvas, size, stride=self.cell)
        weighed = (self.patches * weights).flatten(1)
        images = [
            fold(weighed[some.cpu().flatten(1)].mT, canvas, size, stride=self.cell) / covered
            for some in portions(words)
        ]
        margin = (size - CELLS * self.cell) // 2
        down, across = (
            (torch.arange(side) + margin).clamp(max=end - 1) for side, end in zip(self.image_size, canvas, strict=True)
        )  # of a last cell that is cut, the edge of the patch is repeated
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
        """Images from histograms of visual words alone, each for itself.

        Args:
            histogram: (B, K), float32 or float64, on any device; how often each word is there, as :meth:`histogram`
                counts.  Computed on the CPU.
            image_size: (height, width), which must be the vocabulary's.
            seed: of the order in which swaps are tried, the same for every image of the batch.
            progress: called with the images done and their number.

        Returns:
            Images in 0…1, whose distance is that of their own histogram.  The history is not of distances, but
            (sweeps + 1, B), the cost of the arrangement before and after each sweep over all pairs of places, float64;
            the evaluations are these sweeps.

        Raises:
            TypeError: the histogram is no float32 or float64 tensor.
            ValueError: its shape is another, it holds NaN, Inf or what is no count, or not one word for each place; the
                image size is not the vocabulary's.
        """
        began = time.perf_counter()
        self._check(histogram, image_size)
        given = histogram.detach().cpu().double()
        words, histories, reasons = [], [], []
        for done, counts in enumerate(given):
            if progress:
                progress(done, len(given))
            to_place = np.repeat(np.arange(len(counts)), counts.long().numpy())
            location = self._costs.location(counts.numpy())
            found, history, settled = arrange(to_place, location, self._costs, np.random.default_rng(seed))
            words.append(torch.from_numpy(found))
            histories.append(history)
            reasons.append("no swap of two words lowers the cost" if settled else "all sweeps are used up")
        if progress:
            progress(len(given), len(given))
        image = self.picture(torch.stack(words))
        residual = (self.histogram(image).double() - given).norm(dim=1)
        longest = max(map(len, histories))
        all_costs = [each + [each[-1]] * (longest - len(each)) for each in histories]
        return Reconstruction(
            image.to(histogram),
            (residual / given.norm(dim=1)).to(histogram),
            reasons,
            torch.tensor(all_costs, dtype=torch.float64, device=histogram.device).T,
            torch.tensor([len(each) - 1 for each in histories], device=histogram.device),
            time.perf_counter() - began,
        )

    @cached_property
    def _costs(self) -> Costs:
        return Costs(self.database.numpy().astype(np.int64), self.vocabulary.numpy().astype(np.float64))

    def _check(self, histogram: Tensor, image_size: tuple[int, int] | None) -> None:
        if not isinstance(histogram, Tensor) or histogram.dtype not in (torch.float32, torch.float64):
            got = histogram.dtype if isinstance(histogram, Tensor) else type(histogram).__name__
            raise TypeError(f"the histogram must be a float32 or float64 tensor, got {got}")
        words, places = len(self.vocabulary), self.grid[0] * self.grid[1]
        if histogram.dim() != 2 or histogram.shape[1] != words or not len(histogram):
            raise ValueError(f"the histogram must have shape (B, {words}), B at least 1, got {tuple(histogram.shape)}")
        if image_size is not None and tuple(image_size) != self.image_size:
            raise ValueError(
                f"the words were learned from images of {self.image_size[0]}x{self.image_size[1]} pixels "
                f"(height x width), and cannot make one of {image_size[0]}x{image_size[1]}"
            )
        if not torch.isfinite(histogram).all():
            raise ValueError("the histogram must be finite, got NaN or Inf")
        if not ((histogram >= 0) & (histogram == histogram.round())).all():
            raise ValueError("the histogram must hold counts, whole numbers of at least 0")
        wrong = histogram.sum(1) != places
        if wrong.any():
            counted = float(histogram.sum(1)[wrong][0])
            raise ValueError(f"the histogram must count one word for each of the {places} places, got {counted:g}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is an .npz archive of the arrays ``format`` (1), ``vocabulary``, ``patches``, ``database``, ``image_size``,
        ``cell`` and ``learning`` (JSON).

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {
            "vocabulary": self.vocabulary.numpy(),
            "patches": self.patches.numpy(),
            "database": self.database.numpy(),
            "image_size": self.image_size,
            "cell": self.cell,
            "learning": account_to_text(self.learning),
        }
        write_arrays(path, FORMAT, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BoVW:
        """The words that :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
                arrays contradict each other.
        """
        arrays = read_arrays(path, "BoVW model", _ARRAYS)
        with naming(path):
            check_format(arrays, "BoVW model", FORMAT)
            vocabulary, patches, database = (
                _tensor(name, arrays[name]) for name in ("vocabulary", "patches", "database")
            )
            height, width = _integers(arrays, "image_size", 2)
            (cell,) = _integers(arrays, "cell", 1)
            learning = account_of(Learning, text(arrays, "learning"))
            return cls(vocabulary, patches, database, (height, width), cell, learning)


def check_grid(image_size: tuple[int, int], cell: int) -> tuple[int, int]:
    """Rows and columns of words, once cell and image size are known to make at least two.

    Raises:
        ValueError: they do not.
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


def portions(tensor: Tensor) -> list[Tensor]:
    """Its rows, a few at a time."""
    return [tensor[first : first + _TOGETHER] for first in range(0, len(tensor), _TOGETHER)]


def nearest(descriptors: Tensor, vocabulary: Tensor) -> Tensor:
    """The index (…) of the word (K, n) that is nearest to each descriptor (…, n)."""
    squared = vocabulary.square().sum(1)
    return (squared - 2 * descriptors @ vocabulary.T).argmin(dim=-1)


def _tensor(name: str, array: NDArray[Any]) -> Tensor:
    if array.dtype not in (np.float32, np.int16):
        raise ValueError(f"the {name} must be float32 or int16, got {array.dtype}")
    return torch.from_numpy(array)


def _integers(arrays: dict[str, NDArray[Any]], name: str, count: int) -> list[int]:
    array = arrays[name]
    if array.dtype.kind not in "iu" or array.size != count:
        raise ValueError(f"{name} must hold {count} integers, got {array.dtype} of shape {array.shape}")
    return [int(number) for number in array.ravel()]
