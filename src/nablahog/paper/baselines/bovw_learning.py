"""Learning visual words, their gray patches and their arrangements from photographs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from torch import Tensor

from ...invert.provenance import check_images, digest_of_images
from .bovw import BoVW, BoVWLearning, batches, check_grid, check_patch, nearest_words
from .dense_sift import CELLS, LENGTH, dense_sift

WORDS = 500
CELL = 8  # pixels of a cell's side
PATCH = 40  # pixels of a patch's side
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
    map_function: Callable[..., Iterable[Any]] = map,
) -> BoVW:
    """Learns visual words from photographs.  These, and their mirror images, are also the database of arrangements.

    The codebook is that of k-means on windows with contrast, drawn at random; all without contrast are one more word.
    Words that no window belongs to are left out.

    The result depends on the images, the numbers and the seed alone; on another processor or with another number of
    threads also on rounding, which k-means may amplify.

    Args:
        images: (H, W) each, float32 in 0…1, all of one size, by name.
        words: the size of the codebook, 2 … 32,767.
        cell: of the descriptor, in pixels; a window of 4x4 cells begins at each cell.
        patch: pixels of a patch's side: that of a window, or an even number more.
        seed: of everything random.
        progress: called with the steps done, their number and what is being done.
        map_function: as ``map``, of one or two iterables; may run in other processes.

    Raises:
        ValueError: there are no images, they differ in size, or one is too small or holds other values; fewer windows
            have contrast than there are to be words; a number is out of range.
    """
    if not 2 <= words <= np.iinfo(np.int16).max:
        raise ValueError(f"words must be 2 … {np.iinfo(np.int16).max}, got {words}")
    names = check_images(images)
    height, width = _common_size(names, images)
    check_grid((height, width), cell)
    check_patch(patch, cell)
    steps = ROUNDS + 2
    progress(0, steps, "describing the windows")
    photographs = torch.stack([images[name] for name in names]).unsqueeze(1)
    mirrored_too = torch.cat([photographs, photographs.flip(3)])
    descriptors = torch.cat(list(map_function(partial(dense_sift, cell=cell), batches(mirrored_too))))
    windows = descriptors.flatten(0, 2)
    windows = windows[windows.any(dim=1)]
    count = len(windows)
    if count < words - 1:
        raise ValueError(f"expected at least {words - 1} windows with contrast to find {words} words, got {count}")
    drawn = windows.numpy()[np.random.default_rng(seed).permutation(count)[:WINDOWS]]
    means = _kmeans(drawn, words - 1, lambda done: progress(1 + done, steps, "clustering the windows"))
    vocabulary = torch.cat([torch.zeros(1, LENGTH), torch.from_numpy(means)])
    progress(steps - 1, steps, "averaging the patches of the words")
    assign = partial(_words_and_patches, vocabulary=vocabulary, cell=cell, size=patch)
    words_of_batches, total = [], torch.zeros(())
    for words_of_batch, patches_of_batch in map_function(assign, batches(mirrored_too), batches(descriptors)):
        words_of_batches.append(words_of_batch)
        total = total + patches_of_batch
    database = torch.cat(words_of_batches)
    used, database = torch.unique(database, return_inverse=True)
    mean = total[used] / torch.bincount(database.flatten(), minlength=len(used)).unsqueeze(1)
    patches = mean.float().clamp(0, 1).reshape(len(used), patch, patch)
    progress(steps, steps, f"{len(used)} words")
    learning = BoVWLearning(
        images=tuple(names),
        sha256=digest_of_images(images),
        seed=seed,
        words=words,
        windows=len(drawn),
        rounds=ROUNDS,
    )
    return BoVW(vocabulary[used], patches, database.short(), (height, width), cell, learning)


def _common_size(names: Sequence[str], images: Mapping[str, Tensor]) -> tuple[int, int]:
    """Height and width of all images."""
    height, width = images[names[0]].shape
    for name in names:
        if images[name].shape != (height, width):
            raise ValueError(
                f"expected images of one size, but {names[0]} has {height}x{width} pixels, "
                f"{name} {images[name].shape[0]}x{images[name].shape[1]}"
            )
    return height, width


def _kmeans(windows: NDArray[np.float32], words: int, progress: Callable[[int], None]) -> NDArray[np.float32]:
    """The means (words, n) of k-means on windows (N, n), which begins with the first of them."""
    means = windows[:words]
    for done in range(ROUNDS):
        progress(done)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a mean without windows stays; its word is left out in the end
            means, _ = kmeans2(windows, means, iter=1, minit="matrix")
    return means.astype(np.float32)


def _words_and_patches(
    images: Tensor, descriptors: Tensor, *, vocabulary: Tensor, cell: int, size: int
) -> tuple[Tensor, Tensor]:
    """The words (N, rows, cols) of images (N, 1, H, W), and the sum of the patches of each word, (K, size²), float64.

    The outermost pixels of an image are repeated.
    """
    words = nearest_words(descriptors, vocabulary)
    margin = (size - CELLS * cell) // 2
    down, across = (
        (torch.arange((places - 1) * cell + size) - margin).clamp(0, side - 1)
        for places, side in zip(words.shape[1:], images.shape[2:], strict=True)
    )
    padded = images[:, 0, down[:, None], across]
    patches = padded.unfold(1, size, cell).unfold(2, size, cell)
    total = torch.zeros(len(vocabulary), size * size, dtype=torch.float64)
    return words, total.index_add_(0, words.flatten(), patches.reshape(-1, size * size).double())
