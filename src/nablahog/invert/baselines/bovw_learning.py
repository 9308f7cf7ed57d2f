"""Learning visual words, what they look like and how they are arranged, from photographs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from torch import Tensor

from ..provenance import digest_of_images
from .bovw import BoVW, Learning, check_grid, check_patch, nearest, portions
from .dense_sift import CELLS, LENGTH, dense_sift

WORDS = 500
CELL = 8
PATCH = 40
WINDOWS = 50_000  # to cluster
ROUNDS = 20  # of k-means


@torch.no_grad()
def learn_bovw(
    images: Mapping[str, Tensor],
    *,
    words: int = WORDS,
    cell: int = CELL,
    patch: int = PATCH,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> BoVW:
    """Learns visual words from photographs, which are also the database of arrangements, as they are and mirrored.

    Words are found by k-means on windows drawn at random, among those with contrast; all without are one more word.
    Words that no window of the photographs belongs to are left out.

    The result depends on the images, the numbers and the seed, and on nothing else as long as PyTorch, SciPy, their
    number of threads and the processor stay the same; where they do not, on rounding, which k-means may amplify.

    Args:
        images: (H, W) each, float32 in 0…1, all of one size, by name.
        words: how many to look for, at least 2 and at most 32,767.
        cell: of the descriptor, in pixels; a window is four wide, and there is one at each cell.
        patch: pixels of a word's picture on each side, at least those of a window, by an even number more.
        seed: of everything random.
        progress: called with the steps done, their number and what is being done.

    Raises:
        ValueError: there are no images, they differ in size, or one is too small or holds other values; fewer windows
            have contrast than there are to be words; a number is out of range.
    """
    if not 2 <= words <= np.iinfo(np.int16).max:
        raise ValueError(f"words must be 2 … {np.iinfo(np.int16).max}, got {words}")
    names = sorted(images)
    if not names:
        raise ValueError("expected images to learn from, got none")
    height, width = _check(names, images, cell)
    check_patch(patch, cell)
    steps = ROUNDS + 2
    progress(0, steps, "describing the windows")
    once = torch.stack([images[name] for name in names]).unsqueeze(1)
    both = torch.cat([once, once.flip(3)])
    descriptors = torch.cat([dense_sift(some, cell) for some in portions(both)])
    flat = descriptors.flatten(0, 2)
    seen = flat[flat.any(dim=1)].numpy()
    if len(seen) < words - 1:
        raise ValueError(f"expected at least {words - 1} windows with contrast to find {words} words, got {len(seen)}")
    drawn = np.random.default_rng(seed).permutation(len(seen))[:WINDOWS]
    found = _clustered(seen[drawn], words - 1, lambda done: progress(1 + done, steps, "clustering the windows"))
    vocabulary = torch.cat([torch.zeros(1, LENGTH), torch.from_numpy(found)])
    progress(steps - 1, steps, "looking at the words")
    database = torch.cat([nearest(some, vocabulary) for some in portions(descriptors)])
    used, database = torch.unique(database, return_inverse=True)
    patches = _mean_patches(both, database, len(used), cell, patch)
    progress(steps, steps, f"{len(used)} words")
    learning = Learning(tuple(names), digest_of_images(names, images), words, len(drawn), ROUNDS, seed)
    return BoVW(vocabulary[used], patches, database.short(), (height, width), cell, learning)


def _check(names: Sequence[str], images: Mapping[str, Tensor], cell: int) -> tuple[int, int]:
    """Height and width of all images."""
    first = images[names[0]]
    for name in names:
        image = images[name]
        if image.dim() != 2 or image.dtype != torch.float32 or not ((image >= 0) & (image <= 1)).all():
            raise ValueError(f"{name}: expected an image (H, W) of float32 in 0…1")
        if image.shape != first.shape:
            raise ValueError(
                f"expected images of one size, but {names[0]} has {first.shape[0]}x{first.shape[1]} pixels, "
                f"{name} {image.shape[0]}x{image.shape[1]}"
            )
    height, width = first.shape
    check_grid((height, width), cell)
    return height, width


def _clustered(windows: NDArray[np.float32], words: int, progress: Callable[[int], None]) -> NDArray[np.float32]:
    """The means (words, n) that k-means finds, from the first windows (N, n) on."""
    means = windows[:words]
    for done in range(ROUNDS):
        progress(done)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a word without windows stays where it is, and is left out in the end
            means, _ = kmeans2(windows, means, iter=1, minit="matrix")
    return means.astype(np.float32)


def _mean_patches(images: Tensor, words: Tensor, count: int, cell: int, size: int) -> Tensor:
    """What each word looks like: (count, size, size), the mean of its windows in images (N, 1, H, W).

    Around the images, their outermost pixels are repeated.
    """
    margin = (size - CELLS * cell) // 2
    down, across = (
        (torch.arange((places - 1) * cell + size) - margin).clamp(0, side - 1)
        for places, side in zip(words.shape[1:], images.shape[2:], strict=True)
    )
    total = torch.zeros(count, size * size, dtype=torch.float64)
    for some, of in zip(portions(images), portions(words), strict=True):
        around = some[:, 0, down[:, None], across]
        cut = around.unfold(1, size, cell).unfold(2, size, cell)
        total.index_add_(0, of.flatten(), cut.reshape(-1, size * size).double())
    mean = total / torch.bincount(words.flatten(), minlength=count).unsqueeze(1)
    return mean.float().clamp(0, 1).reshape(count, size, size)
