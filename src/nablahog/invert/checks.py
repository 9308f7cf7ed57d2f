"""Checks of descriptors and of images given with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog.inputs import ArrayImage, descriptor_tensor, image_batch
from ..hog.spec import HOGSpec

LARGEST_ENTRY = 1e6  # far above any descriptor of an image, and small enough that energies of energies do not overflow


def descriptors_as_tensor(descriptor: Tensor | NDArray[Any]) -> Tensor:
    """Descriptors (B, rows, cols, channels); an array (rows, cols, channels) is a batch of one.

    Raises:
        TypeError: it is neither a tensor nor an array.
    """
    if isinstance(descriptor, Tensor):
        return descriptor
    tensor = descriptor_tensor("the descriptor", descriptor)
    return tensor[None] if tensor.dim() == 3 else tensor


def check_floats(name: str, tensor: object) -> None:
    """Raises TypeError unless ``tensor`` is one of float32 or float64."""
    got = tensor.dtype if isinstance(tensor, Tensor) else type(tensor).__name__
    if got not in (torch.float32, torch.float64):
        raise TypeError(f"{name} must be a float32 or float64 tensor, got {got}")


def check_finite(name: str, tensor: Tensor) -> None:
    """Raises ValueError if ``tensor`` holds NaN or Inf."""
    if not torch.isfinite(tensor).all():
        raise ValueError(f"{name} must be finite, got NaN or Inf")


def check_descriptor(descriptor: Tensor, spec: HOGSpec, image_size: Sequence[int] | None) -> tuple[int, int]:
    """Height and width of the image, after checking that descriptor, spec and image size agree.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`.
    """
    check_floats("the descriptor", descriptor)
    if descriptor.dim() != 4 or not len(descriptor):
        raise ValueError(
            f"the descriptor must have shape (B, rows, cols, channels), B at least 1, got {tuple(descriptor.shape)}"
        )
    rows, cols, channels = descriptor.shape[1:]
    height, width = image_size or spec.image_size(rows, cols)
    expected = (*spec.grid(height, width), spec.channels)
    if (rows, cols, channels) != expected:
        raise ValueError(
            f"{spec.named} descriptor of an image of {height}x{width} pixels must have shape "
            f"{expected} (rows, cols, channels), got {(rows, cols, channels)}"
        )
    check_finite("the descriptor", descriptor)
    largest = float(descriptor.detach().abs().max())
    if largest > LARGEST_ENTRY:
        raise ValueError(f"the descriptor's entries must be at most {LARGEST_ENTRY:g} in size, got one of {largest:g}")
    return height, width


def check_images(
    name: str, images: Tensor | ArrayImage | None, descriptor: Tensor, size: tuple[int, int], spec: HOGSpec
) -> Tensor | None:
    """``images``, their roots where the dialect describes these, in the descriptor's dtype and on its device, or None.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`.
    """
    if images is None:
        return None
    if not isinstance(images, Tensor):
        images, _ = image_batch(name, images)
        images = images / 255 if images.dtype == torch.uint8 else images
    if not images.is_floating_point():
        raise TypeError(f"{name} must be floating-point, got {images.dtype}")
    if images.shape != (len(descriptor), 1, *size):
        raise ValueError(f"{name} must have shape {(len(descriptor), 1, *size)}, got {tuple(images.shape)}")
    check_finite(name, images)
    images = images.detach().to(descriptor)
    return images.clamp(min=0).sqrt() if spec.gamma == "sqrt" else images
