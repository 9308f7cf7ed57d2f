"""Visual words learned from photographs: k-means on windows, and the mean patch of each word."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from torch import Tensor

from ...inputs.training_images import digest_of_images, gray_photographs
from ...io.checkpoint import Checkpoint
from .bovw import IMAGE_BATCH, BoVW, BoVWLearning, check_grid, check_patch, nearest_words
from .dense_sift import LENGTH, WINDOW_CELLS, dense_sift

WORDS = 500
CELL_SIDE = 8  # pixels of a cell's side
PATCH_SIDE = 40  # pixels of a patch's side
CLUSTERED_WINDOWS = 50_000  # to cluster
ROUNDS = 20  # of k-means


@torch.no_grad()
def learn_bovw(
    images: Mapping[str, Tensor],
    *,
    words: int = WORDS,
    cell: int = CELL_SIDE,
    patch: int = PATCH_SIDE,
    seed: int = 0,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    map_function: Callable[..., Iterable[Any]] = map,
) -> BoVW:
    """Learns visual words from photographs.  These, and their mirror images, are also the database.

    The codebook is that of k-means on windows with contrast, drawn at random; all without contrast are one more word.
    Words that no window belongs to are left out.  On another processor, or with another number of threads, the result
    also depends on rounding, which k-means may amplify.

    Args:
        images: (H, W), float32 in 0…1, all of one size, by name.
        words: the size of the codebook, 2 … 32,767.
        cell: of the descriptor, in pixels; a window of 4x4 cells begins at each cell.
        patch: pixels of a patch's side: that of a window, or an even number more.
        seed: the seed of all random numbers.
        checkpoint: a file that is written after each round of k-means.  If it exists and is of the same learning, this
            is resumed, with the same result.  The file is not removed.
        progress: called with the steps done, their number and what is being done.
        map_function: as ``map``, of one or two iterables; may run in other processes.

    Raises:
        ValueError: images or numbers are not as above, or fewer windows have contrast than there are to be words; the
            checkpoint is damaged or of another learning.
        OSError: the checkpoint cannot be read or written.
    """
    if not 2 <= words <= np.iinfo(np.int16).max:
        raise ValueError(f"words must be 2 … {np.iinfo(np.int16).max}, got {words}")
    photographs = gray_photographs(images)
    first, image = next(iter(photographs.items()))
    height, width = image.shape
    for name, image in photographs.items():
        if image.shape != (height, width):
            sizes = f"{first} has {height}x{width} pixels, {name} {'x'.join(map(str, image.shape))}"
            raise ValueError(f"expected images of one size, but {sizes}")
    check_grid((height, width), cell)
    check_patch(patch, cell)
    steps = ROUNDS + 2
    progress(0, steps, "describing the windows")
    batch = torch.stack([*photographs.values()]).unsqueeze(1)
    mirrored_too = torch.cat([batch, batch.flip(3)])
    descriptors = torch.cat(list(map_function(partial(dense_sift, cell=cell), torch.split(mirrored_too, IMAGE_BATCH))))
    windows = descriptors.flatten(0, 2)
    windows = windows[windows.any(dim=1)]
    count = len(windows)
    if count < words - 1:
        raise ValueError(f"expected at least {words - 1} windows with contrast to find {words} words, got {count}")
    drawn = windows.numpy()[np.random.default_rng(seed).permutation(count)[:CLUSTERED_WINDOWS]]
    digest = digest_of_images(photographs)
    file = Checkpoint(checkpoint, {"images": digest, "words": words, "cell": cell, "seed": seed})
    means = _kmeans(drawn, words - 1, file, lambda done: progress(1 + done, steps, "clustering the windows"))
    vocabulary = torch.cat([torch.zeros(1, LENGTH), torch.from_numpy(means)])
    progress(steps - 1, steps, "averaging the patches of the words")
    assign = partial(_words_and_patches, vocabulary=vocabulary, cell=cell, size=patch)
    of_images, total = [], torch.zeros(())
    batches = torch.split(mirrored_too, IMAGE_BATCH), torch.split(descriptors, IMAGE_BATCH)
    for words_of_batch, patches in map_function(assign, *batches):
        of_images.append(words_of_batch)
        total = total + patches
    used, database = torch.unique(torch.cat(of_images), return_inverse=True)
    mean = total[used] / torch.bincount(database.flatten(), minlength=len(used)).unsqueeze(1)
    patches = mean.float().clamp(0, 1).reshape(len(used), patch, patch)
    progress(steps, steps, f"{len(used)} words")
    learning = BoVWLearning(
        images=tuple(photographs), sha256=digest, seed=seed, words=words, windows=len(drawn), rounds=ROUNDS
    )
    return BoVW(vocabulary[used], patches, database.short(), (height, width), cell, learning)


def _kmeans(
    windows: NDArray[np.float32], words: int, checkpoint: Checkpoint, progress: Callable[[int], None]
) -> NDArray[np.float32]:
    """The means (words, n) of k-means on windows (N, n), which starts from the first windows."""
    saved: dict[str, Any] = {"done": 0, "means": torch.from_numpy(windows[:words])}
    checkpoint.resume(saved.update)
    means: NDArray[np.float32] = saved["means"].numpy()
    for done in range(saved["done"], ROUNDS):
        progress(done)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a mean without windows stays; its word is left out in the end
            means, _ = kmeans2(windows, means, iter=1, minit="matrix")
        checkpoint.save({"done": done + 1, "means": torch.from_numpy(means)})
    return means.astype(np.float32)


def _words_and_patches(
    images: Tensor, descriptors: Tensor, *, vocabulary: Tensor, cell: int, size: int
) -> tuple[Tensor, Tensor]:
    """The words (N, rows, cols) of images (N, 1, H, W), and the sum of the patches of each word, (K, size²), float64.

    The outermost pixels of an image are repeated.
    """
    words = nearest_words(descriptors, vocabulary)
    margin = (size - WINDOW_CELLS * cell) // 2
    down, across = (
        (torch.arange((places - 1) * cell + size) - margin).clamp(0, side - 1)
        for places, side in zip(words.shape[1:], images.shape[2:], strict=True)
    )
    padded = images[:, 0, down[:, None], across]
    patches = padded.unfold(1, size, cell).unfold(2, size, cell)
    total = torch.zeros(len(vocabulary), size * size, dtype=torch.float64)
    return words, total.index_add_(0, words.flatten(), patches.reshape(-1, size * size).double())
