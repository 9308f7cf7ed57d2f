"""Nearest neighbours: each patch of the image is the mean of those that photographs have under similar windows.

What Vondrick et al. call the exemplar-LDA baseline of HOGgles (ICCV 2013) averages the images of a database that a
detector trained on the descriptor scores highest.  Theirs are whole detection windows; here they are windows of 5x5
cells around each cell, by Euclidean distance, so that images of any size can be inverted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from ...hog.spec import HOGSpec
from ...invert.provenance import Learning, digest_of_images
from ...io.learned_model import SPEC, Codec, account
from .window_model import WindowModel
from .windows import Pairs, average_patches, check_images, crop, patch_size, stretched, windows_at_cells

CELLS = 5  # of the side of a window and of a patch
WINDOWS = 100_000
NEIGHBOURS = 32
BATCH = 256  # windows whose distances to all others are in memory at a time
_ARRAY = Codec(lambda value: value, lambda arrays, name: arrays[name])


@dataclass(frozen=True, kw_only=True)
class NearestLearning(Learning):
    """What the database was made of.

    Attributes:
        windows: the most that are drawn from the images.
    """

    windows: int


@dataclass(frozen=True, eq=False, repr=False)
class NearestWindows(WindowModel):
    """A database of photographs.  Windows and their patches are drawn from it at the first inversion.

    Its file has the ``pixels`` of all images, one after another, and their ``sizes``, (N, 2).

    Attributes:
        spec: the dialect.
        images: (H, W) each, uint8, at least one.
        learning: what they are.
        neighbours: whose mean a patch is, at least 1; all windows if there are fewer.

    Raises:
        ValueError: these contradict each other.
    """

    KIND = "window database"
    NOUN = "database"
    ARRAYS: ClassVar = {"spec": SPEC, "pixels": _ARRAY, "sizes": _ARRAY, "learning": account(NearestLearning)}
    COMPRESSED = True

    spec: HOGSpec
    images: tuple[Tensor, ...]
    learning: NearestLearning
    neighbours: int = NEIGHBOURS

    def __post_init__(self) -> None:
        if not self.images or len(self.images) != len(self.learning.images):
            names = len(self.learning.images)
            raise ValueError(f"expected at least one image, and one for each of {names} names, got {len(self.images)}")
        for image in self.images:
            if image.dtype != torch.uint8 or image.dim() != 2:
                raise ValueError(f"expected images (H, W) of uint8, got {image.dtype} of {tuple(image.shape)}")
            self.spec.grid(*image.shape)
        for name, number, least in (
            ("windows", self.learning.windows, 1),
            ("seed", self.learning.seed, 0),
            ("neighbours", self.neighbours, 1),
        ):
            if number < least:
                raise ValueError(f"{name} must be at least {least}, got {number}")

    @property
    def summary(self) -> str:
        return f"{len(self.images)} images"

    def _values(self) -> dict[str, Any]:
        return {
            "spec": self.spec,
            "pixels": torch.cat([image.flatten() for image in self.images]).numpy(),
            "sizes": [tuple(image.shape) for image in self.images],
            "learning": self.learning,
        }

    @classmethod
    def _of(cls, values: dict[str, Any]) -> NearestWindows:
        pixels, sizes = values["pixels"], values["sizes"]
        if pixels.dtype != np.uint8 or sizes.dtype.kind not in "iu" or sizes.ndim != 2 or sizes.shape[1] != 2:
            raise ValueError(
                f"expected pixels of uint8 and integer sizes (N, 2), got {pixels.dtype} and {sizes.dtype} of shape "
                f"{sizes.shape}"
            )
        shapes = [(int(height), int(width)) for height, width in sizes.tolist()]
        counts = list(map(math.prod, shapes))
        if min(map(min, shapes), default=0) < 1 or pixels.shape != (sum(counts),):
            raise ValueError(f"the sizes of the images must make {pixels.size} pixels")
        parts = torch.split(torch.from_numpy(pixels), counts)
        images = tuple(part.view(shape) for part, shape in zip(parts, shapes, strict=True))
        return cls(values["spec"], images, values["learning"])

    def _batch_size(self, rows: int, cols: int) -> int:
        return 1

    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        windows = windows_at_cells(descriptor, CELLS)
        batches = torch.split(windows.flatten(0, 2), BATCH)
        patches = torch.cat([self._mean_patches(batch) for batch in batches]).view(*windows.shape[:3], -1)
        return stretched(crop(average_patches(patches, self.spec, CELLS), self.spec, CELLS // 2, size))

    def _mean_patches(self, x: Tensor) -> Tensor:
        """The mean patch (N, pixels) of the nearest windows of each of (N, n)."""
        windows, half_squares, patches = self._database
        similarity = x @ windows.T - half_squares  # -½‖x - y‖² without the constant -½‖x‖²
        nearest = similarity.topk(min(self.neighbours, len(windows)), dim=1).indices
        total = torch.zeros(len(x), patches.shape[1])
        for each in nearest.T:
            total += patches[each]
        return total / (255 * nearest.shape[1])

    @cached_property
    def _database(self) -> tuple[Tensor, Tensor, Tensor]:
        """Windows (N, n), half their squared lengths (N,), and patches (N, pixels), uint8."""
        images = [image.float() / 255 for image in self.images]
        rng = np.random.default_rng(self.learning.seed)
        pairs = Pairs(images, self.spec, CELLS, self.learning.windows, rng)
        windows = torch.empty(len(pairs), CELLS * CELLS * self.spec.channels)
        patches = torch.empty(len(pairs), math.prod(patch_size(self.spec, CELLS)), dtype=torch.uint8)
        first = 0
        for x, of_image in pairs:
            last = first + len(x)
            windows[first:last], patches[first:last] = x, (of_image * 255).round().byte()
            first = last
        return windows, windows.square().sum(1) / 2, patches


def learn_nearest(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    windows: int = WINDOWS,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> NearestWindows:
    """Makes a database of photographs.

    Args:
        images: (H, W) each, float32 in 0…1, by name; stored in 256 gray levels.
        spec: the dialect.
        windows: the most to search among; of more, so many are drawn at random.
        seed: of everything random.
        progress: called with the images done, their number and what is being done.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; ``windows`` is below 1.
    """
    names = check_images(images, spec)
    progress(0, len(names), "storing the images")
    stored = tuple((images[name] * 255).round().byte() for name in names)
    progress(len(names), len(names), "")
    learning = NearestLearning(images=tuple(names), sha256=digest_of_images(images), seed=seed, windows=windows)
    return NearestWindows(spec, stored, learning)
