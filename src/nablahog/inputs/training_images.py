"""Photographs to learn from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from .arrays import AS_GRAY, WHITE, as_gray
from .numbers import shortened


def gray_photographs(images: Mapping[str, object], least: tuple[int, int] = (1, 1)) -> dict[str, Tensor]:
    """Photographs to learn from, (H, W), float32 in 0…1, on the CPU, in the order of their names.

    Args:
        images: tensors, arrays or PIL images, gray, in 0…1 or uint8, by name.
        least: (height, width) of the smallest that is taken.

    Raises:
        TypeError: they have no names, or one is no image of real numbers.
        ValueError: there are none, or one has other axes, other values or fewer pixels.
    """
    if not isinstance(images, Mapping):
        raise TypeError(
            f"images must be a dict of images by name, got {type(images).__name__}: "
            "write {str(k): image for k, image in enumerate(images)}"
        )
    unnamed = next((name for name in images if not isinstance(name, str)), None)
    if unnamed is not None:
        raise TypeError(
            f"names of images must be texts, got {shortened(unnamed)}: write {{str(k): image for k, image in "
            "images.items()}"
        )
    if not images:
        raise ValueError("expected images to learn from, got none")
    photographs = {}
    for name in sorted(images):
        image = as_gray(name, images[name])
        if image.ndim != 2:
            raise ValueError(f"{name} must be gray, (H, W), got shape {image.shape}: write {AS_GRAY}")
        height, width = image.shape
        if height < least[0] or width < least[1]:
            raise ValueError(f"{name} must have at least {least[0]}x{least[1]} pixels, got {height}x{width}")
        if not (image.min() >= 0 and image.max() <= 1):
            raise ValueError(f"{name} must have gray values in 0…1, got {image.min():g} … {image.max():g}{WHITE}")
        photographs[name] = torch.from_numpy(image.astype(np.float32))
    return photographs


def digest_of_images(images: Mapping[str, Tensor]) -> str:
    """The SHA-256 of the names, sizes and pixels of images (H, W), in the order of their names, hexadecimal."""
    digest = hashlib.sha256()
    for name in sorted(images):
        digest.update(f"{name}\0{tuple(images[name].shape)}\0".encode(errors="backslashreplace"))
        digest.update(np.ascontiguousarray(images[name].numpy()).tobytes())
    return digest.hexdigest()
