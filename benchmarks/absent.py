"""Images without the object, for `confidence.py`: photographs of other things, and synthetic textures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from nablahog.io.images import read_image

Grid: TypeAlias = NDArray[Any]
Generator: TypeAlias = np.random.Generator
Box: TypeAlias = tuple[float, float, float, float]

ENDINGS = {".png", ".jpg", ".jpeg", ".webp"}
SIDE = 256  # pixels of textures
TEXTURE_SHARE = 0.25  # of all images
BOX = 0.35, 0.95  # sides of random boxes, as shares of the image's


def _turn(x: Grid, y: Grid, angle: float) -> tuple[Grid, Grid]:
    return x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)


def bricks(x: Grid, y: Grid, generator: Generator) -> Grid:
    height, width, joint = generator.uniform(10, 40), generator.uniform(20, 90), generator.uniform(1, 4)
    row = (y // height).astype(int)
    moved = x + row % 2 * width / 2
    brightness = generator.uniform(0.4, 0.8, (64, 64))[row % 64, (moved // width).astype(int) % 64]
    return np.where((y % height > joint) & (moved % width > joint), brightness, generator.uniform(0, 0.4))


def stripes(x: Grid, y: Grid, generator: Generator) -> Grid:
    across, _ = _turn(x, y, generator.uniform(0, math.pi))
    wave = np.sin(2 * math.pi * across / generator.uniform(6, 50))
    return 0.5 + 0.4 * (np.sign(wave) if generator.random() < 0.5 else wave)


def noise(x: Grid, y: Grid, generator: Generator) -> Grid:
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE)))
    frequency[0, 0] = 1
    spectrum = np.fft.fft2(generator.normal(size=x.shape)) / frequency ** generator.uniform(0, 2)
    values: Grid = np.fft.ifft2(spectrum).real
    standard: Grid = (values - values.mean()) / values.std()
    return 0.5 + 0.2 * standard


def checks(x: Grid, y: Grid, generator: Generator) -> Grid:
    along, across = _turn(x, y, generator.uniform(0, 0.6))
    wide, high = generator.uniform(8, 60, 2)
    squares: Grid = (along // wide + across // high) % 2
    return 0.2 + 0.6 * squares


def lattice(x: Grid, y: Grid, generator: Generator) -> Grid:
    along, across = _turn(x, y, generator.uniform(0, 0.8))
    period, bar = generator.uniform(12, 50), generator.uniform(1, 6)
    return 0.3 + 0.5 * ((along % period < bar) | (across % period < bar))


def rectangles(x: Grid, y: Grid, generator: Generator) -> Grid:
    values = np.full(x.shape, generator.random())
    for _ in range(int(generator.integers(10, 60))):
        left, top, width, height = (*generator.integers(0, SIDE, 2), *generator.integers(5, 90, 2))
        values[top : top + height, left : left + width] = generator.random()
    return values


TEXTURES: Mapping[str, Callable[[Grid, Grid, Generator], Grid]] = {
    "bricks": bricks,
    "stripes": stripes,
    "noise": noise,
    "checks": checks,
    "lattice": lattice,
    "rectangles": rectangles,
}


def texture(name: str, generator: Generator) -> Tensor:
    """One of :data:`TEXTURES`, (1, SIDE, SIDE), in 0…1, with a little noise."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float64)
    values = TEXTURES[name](x, y, generator) + generator.normal(0, generator.uniform(0, 0.05), x.shape)
    return torch.from_numpy(values.clip(0, 1).astype(np.float32))[None]


def random_box(image: Tensor, generator: Generator) -> Box:
    height, width = image.shape[1:]
    wide, high = generator.uniform(*BOX) * width, generator.uniform(*BOX) * height
    left, top = generator.uniform(0, width - wide), generator.uniform(0, height - high)
    return left, top, left + wide, top + high


def plain_backgrounds(generator: Generator) -> Iterator[Grid]:
    """Walls, endlessly: of one brightness or a gradient, some with a darker floor, (1, 500, 500)."""
    y, x = np.mgrid[:500, :500] / 500 - 0.5
    while True:
        across, _ = _turn(x, y, generator.uniform(0, 2 * math.pi))
        wall = generator.choice([1.0, generator.random()]) + generator.choice([0.0, 0.4]) * across
        floor = generator.choice([0.0, 0.3]) * (y > generator.uniform(0, 0.3))
        yield (wall - floor).clip(0, 1)[None]


def absent_images(
    folders: Sequence[Path], textures: Sequence[str], count: int, seed: int
) -> Iterator[tuple[str, Tensor]]:
    """So many names and images: photographs of folders, each folder as often as any other, and textures."""
    files = [sorted(file for file in folder.iterdir() if file.suffix.lower() in ENDINGS) for folder in folders]
    for index in range(count):
        generator = np.random.default_rng([seed, index, 7])
        if textures and (not files or generator.random() < TEXTURE_SHARE):
            name = str(generator.choice(textures))
            yield name, texture(name, generator)
        else:
            own = files[int(generator.integers(len(files)))]
            file = own[int(generator.integers(len(own)))]
            yield f"{file.parent.name}/{file.name}", read_image(file)
