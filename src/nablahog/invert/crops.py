"""Squares of photographs to learn from."""

from __future__ import annotations

import random
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from ..hog.spec import HOGSpec

WINDOW = 128  # pixels of a crop's side, at most
LEAST_SHRUNK = 64  # pixels of an image's shorter side, below which it is not shrunk
LEAST_FACTOR = 0.5


def least_side(cell: int) -> int:
    """Pixels that both sides of an image must have at least, to learn for cells of ``cell`` pixels from it."""
    return max(32, 4 * cell)


def crop_count(height: int, width: int) -> int:
    """The number of crops of an image of this size in an epoch, about as many as cover it."""
    return max(1, round(height * width / WINDOW**2))


class CropTraining:
    """What trainings share whose batches are crops, each image as often as it gives crops.

    Args:
        images: (H, W) each.
        spec: the dialect.
        seed: of everything random.

    Attributes:
        batch: crops of a batch.
        order: the images, one for each crop.
        steps: of an epoch.
        crops: of an epoch.
    """

    batch: int

    def __init__(self, images: Sequence[Tensor], spec: HOGSpec, seed: int) -> None:
        self.order = [image for image in images for _ in range(crop_count(*image.shape))]
        self.spec, self.seed = spec, seed
        self.steps = max(1, len(self.order) // self.batch)
        self.crops = self.steps * min(self.batch, len(self.order))

    def calibrate(self, network: nn.Module) -> None:
        """Nothing: the network says nothing of its confidence."""


def draw_crops(images: Sequence[Tensor], cell: int, rng: random.Random) -> Tensor:
    """One crop of each image, all of one size, (B, 1, h, w) in 0…1.

    Place and mirroring are random.  An image larger than :data:`WINDOW` is first shrunk by a random factor.  Half of
    the sizes are whole cells, as of images that were cropped for HOG.

    Args:
        images: (H, W) each, float32 in 0…1, each side at least :func:`least_side`.
        cell: pixels of a cell's side.
        rng: of place, size and mirroring.
    """
    factors = [_factor(image.shape, rng) for image in images]
    sides = [min(int(image.shape[axis] * f) for image, f in zip(images, factors, strict=True)) for axis in (0, 1)]
    height, width = (_side(min(side, WINDOW), cell, rng) for side in sides)
    return torch.stack([_crop(image, f, height, width, rng) for image, f in zip(images, factors, strict=True)])


def _factor(shape: torch.Size, rng: random.Random) -> float:
    if max(shape) <= WINDOW:
        return 1.0
    return rng.uniform(min(1.0, max(LEAST_FACTOR, LEAST_SHRUNK / min(shape))), 1.0)


def _side(available: int, cell: int, rng: random.Random) -> int:
    whole = (available - 1) // cell * cell  # smaller than the image, so that cells begin anywhere in it
    return whole if rng.random() < 0.5 else whole - rng.randrange(cell)


def _crop(image: Tensor, factor: float, height: int, width: int, rng: random.Random) -> Tensor:
    rows, cols = (min(size, round(n / factor)) for n, size in zip((height, width), image.shape, strict=True))
    top, left = (rng.randrange(size - n + 1) for n, size in zip((rows, cols), image.shape, strict=True))
    crop = image[None, top : top + rows, left : left + cols]
    if (rows, cols) != (height, width):
        crop = interpolate(crop[None], (height, width), mode="bicubic", antialias=True, align_corners=False)[0]
        crop = crop.clamp(0, 1)  # bicubic overshoots at edges
    return crop.flip(2) if rng.random() < 0.5 else crop
