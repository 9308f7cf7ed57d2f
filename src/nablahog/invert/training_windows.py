"""Windows of photographs, to train the networks of priors on."""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

from torch import Tensor
from torch.nn.functional import interpolate

BATCH = 32
CELL = 8  # pixels of the cells of a window
HELD_OUT = 25  # one image of so many is not trained with


class WindowTraining(ABC):
    """The batches of windows and the loss of a training, with one window of each image in an epoch.

    Everything random depends only on the seed and the epoch, so that an interruption does not change it.

    Args:
        images: (H, W) each, float32 in 0…1.
        seed: of everything random.

    Attributes:
        default_crops: of all epochs, by default.
        learning_rate: the largest.
        weight_decay: of AdamW.
        grids: sizes of a window in cells; each batch has one of them.
        gamma: the largest logarithm of the exponent of gray values.
        held_out: images that are not trained with.
        steps: of an epoch.
        crops: of an epoch.
    """

    default_crops: int
    learning_rate: float
    weight_decay: float
    grids: Sequence[tuple[int, int]]
    gamma: float

    def __init__(self, images: Sequence[Tensor], seed: int) -> None:
        self.held_out = list(images[HELD_OUT // 2 :: HELD_OUT])
        self.images = [image for k, image in enumerate(images) if k % HELD_OUT != HELD_OUT // 2]
        self.seed = seed
        self.steps = max(1, len(self.images) // BATCH)
        self.crops = self.steps * min(BATCH, len(self.images))

    @abstractmethod
    def loss(self, network: Any, batch: Any) -> Tensor:
        """The loss of the network for one batch."""

    def calibrate(self, network: Any) -> None:
        """Calibrates the confidence of the trained network on the images held out; by default it has none."""
        return

    def batches(self, epoch: int) -> Iterator[Any]:
        """The batches of an epoch, NamedTuples of tensors, in an order of its own."""
        order = random.Random(f"{self.seed} {epoch}").sample(self.images, len(self.images))
        for step in range(self.steps):
            rng = random.Random(f"{self.seed} {epoch} {step}")
            grid = rng.choice(self.grids)
            yield self._batch(order[step * BATCH : (step + 1) * BATCH], grid, rng)

    @abstractmethod
    def _batch(self, images: Sequence[Tensor], grid: tuple[int, int], rng: random.Random) -> Any:
        """A batch of windows of ``grid`` cells."""

    @abstractmethod
    def _scale(self, largest: float, rng: random.Random) -> float:
        """Pixels of the photograph per pixel of the window, along each axis; at most ``largest``."""

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
