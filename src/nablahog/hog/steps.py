"""The reference of the four steps: operations of PyTorch, on any device, differentiable any number of times.

:mod:`.kernels` has them compiled for CPUs.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .gradient import gradient
from .orientation import votes
from .pooling import pool
from .spec import HOGSpec


def _scaled(images: Tensor, spec: HOGSpec) -> Tensor:
    """Images in 0…``spec.value_range``, floating point."""
    if images.dtype == torch.uint8:
        return images.to(torch.get_default_dtype()) * (spec.value_range / 255)
    return images if spec.value_range == 1 else images * spec.value_range


def spread_nan(x: Tensor, images: Tensor) -> Tensor:
    """``x`` (B, …), NaN with NaN derivatives where the image has a pixel that is not finite, in any channel."""
    if not images.is_floating_point():
        return x
    image = images.detach()
    one_or_nan = 1 + 0 * image.amax((1, 2, 3)) + 0 * image.amin((1, 2, 3))  # neither makes a copy
    return x * one_or_nan.to(x.dtype).reshape(-1, *(1,) * (x.dim() - 1))


def histograms_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, colours · bins, rows, cols)."""
    with torch.autocast(images.device.type, enabled=False):  # its half precision would show in every library's parity
        gx, gy = gradient(spread_nan(_scaled(images, spec), images), spec)  # Eq. 1-2
        cells = pool(votes(gx, gy, spec), spec)  # Eq. 3-6
        return spread_nan(cells.reshape(-1, spec.colours * spec.bins, *cells.shape[2:]), images)


def normalize_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    each = histograms.reshape(-1, spec.bins, *histograms.shape[2:])
    with torch.autocast(histograms.device.type, enabled=False):
        descriptor = spec.normalizer.normalize(each, spec.signed)
    return descriptor.reshape(-1, spec.channels, *descriptor.shape[2:])
