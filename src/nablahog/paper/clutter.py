"""What is behind an object, or in front of it: parts of photographs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from ..hog.gradient import GRAY_WEIGHTS
from ..io.images import Picture, as_array

Floats: TypeAlias = NDArray[np.float64]
Range: TypeAlias = tuple[float, float]


def clutter(
    photographs: Sequence[Picture],
    shape: tuple[int, ...],
    generator: np.random.Generator,
    *,
    zoom: Range,
    contrast: Range,
    tint: float,
) -> Floats:
    """A random crop of a photograph, rescaled, with another contrast, possibly mirrored; in colour if it is gray.

    Args:
        photographs: gray (h, w) or (1, h, w), or R, G, B (3, h, w), in 0…1, of which only the one that is drawn is
            asked for.
        shape: H, W, pixels.
        generator: of random numbers.
        zoom, contrast, tint: as :class:`.scenes.SceneSettings` has them.

    Returns:
        (3, H, W), float64 in 0…1.

    Raises:
        ValueError: the photograph is none of the above.
    """
    photo = _checked(photographs[int(generator.integers(len(photographs)))])
    room = np.array(photo.shape[1:])
    sides = np.minimum(np.array(shape) * min(generator.uniform(*zoom), *(room / shape)), room).astype(int).clip(min=1)
    top, left = generator.integers(0, room - sides + 1)
    part = photo[:, top : top + sides[0], left : left + sides[1]]
    if generator.random() < 0.5:
        part = part[:, :, ::-1]
    tensor = torch.from_numpy(part.copy())[None]
    scaled: Floats = functional.interpolate(tensor, shape, mode="bicubic", antialias=True)[0].numpy()
    scaled = scaled.mean() + generator.uniform(*contrast) * (scaled - scaled.mean())
    return np.asarray(scaled if len(photo) == 3 else scaled * colours(tint, generator)).clip(0, 1)


def colours(tint: float, generator: np.random.Generator) -> Floats:
    """(3, 1, 1): random factors of R, G and B that do not change the gray of Eq. 1."""
    factors = 1 + tint * generator.uniform(-1, 1, 3)
    balanced: Floats = (factors / np.dot(GRAY_WEIGHTS, factors))[:, None, None]
    return balanced


def _checked(picture: Picture) -> Floats:
    values = as_array(picture)
    if values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or len(values) not in (1, 3) or 0 in values.shape:
        raise ValueError(f"expected a photograph of shape (H, W), (1, H, W) or (3, H, W), got {values.shape}")
    if not (values.min() >= 0 and values.max() <= 1):  # NaN fails too
        raise ValueError(f"expected a photograph in 0…1, got {values.min():g} … {values.max():g}")
    return values
