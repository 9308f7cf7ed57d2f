"""Windows of photographs, which the networks of priors are trained with."""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

from torch import Tensor
from torch.nn.functional import interpolate

from ..hog.spec import HOGSpec

BATCH = 32
CELL = 8  # pixels of the cells of a window
HELD_OUT = 25  # one image of so many is not trained with, to judge by


class WindowTraining(ABC):
    """What trainings share whose batches are windows, one of each image in an epoch.

    What is random depends on the seed and the epoch alone, so that an interruption does not change it.

    Args:
        images: (H, W) each, float32 in 0…1.
        spec: ignored: a network takes the histograms of all dialects of its kind alike.
        seed: of everything random.

    Attributes:
        grids: numbers of cells of a window, of which each batch takes one.
        gamma: the logarithm of the exponent of gray values is at most this.
        held_out: images that are not trained with.
        steps: of an epoch.
        crops: of an epoch.
    """

    grids: Sequence[tuple[int, int]]
    gamma: float

    def __init__(self, images: Sequence[Tensor], spec: HOGSpec, seed: int) -> None:
        self.held_out = list(images[HELD_OUT // 2 :: HELD_OUT])
        self.images = [image for k, image in enumerate(images) if k % HELD_OUT != HELD_OUT // 2]
        self.seed = seed
        self.steps = max(1, len(self.images) // BATCH)
        self.crops = self.steps * min(BATCH, len(self.images))

    def batches(self, epoch: int) -> Iterator[Any]:
        """The batches of an epoch, in its own order."""
        order = random.Random(f"{self.seed} {epoch}").sample(self.images, len(self.images))
        for step in range(self.steps):
            rng = random.Random(f"{self.seed} {epoch} {step}")
            grid = rng.choice(self.grids)
            yield self._batch(order[step * BATCH : (step + 1) * BATCH], grid, rng)

    @abstractmethod
    def _batch(self, images: Sequence[Tensor], grid: tuple[int, int], rng: random.Random) -> Any:
        """One of windows of ``grid`` cells."""

    @abstractmethod
    def _scale(self, largest: float, rng: random.Random) -> float:
        """Pixels of the photograph for one of a window, along each axis; at most ``largest``."""

    def _window(self, image: Tensor, grid: tuple[int, int], rng: random.Random) -> Tensor:
        """A window (1, 1, 8R, 8C) of an image (H, W): its place, size, mirroring and gamma are random."""
        height, width = (CELL * n for n in grid)
        scale = self._scale(min(image.shape[0] / height, image.shape[1] / width), rng)
        rows, cols = (max(1, math.floor(n * scale)) for n in (height, width))
        top, left = (rng.randrange(n - size + 1) for n, size in zip(image.shape, (rows, cols), strict=True))
        window = resized(image[top : top + rows, left : left + cols], height, width)
        window = window ** math.exp(rng.uniform(-self.gamma, self.gamma))
        return window.flip(3) if rng.random() < 0.5 else window


def resized(image: Tensor, height: int, width: int) -> Tensor:
    """An image (H, W) as (1, 1, height, width)."""
    if image.shape == (height, width):
        return image[None, None]
    return interpolate(image[None, None], (height, width), mode="bilinear", antialias=True, align_corners=False)
