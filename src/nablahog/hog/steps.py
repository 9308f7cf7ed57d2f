"""The reference of the four steps: operations of PyTorch, on any device, differentiable any number of times.

:mod:`.kernels` has them compiled for CPUs.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .gradient import gradient
from .orientation import votes
from .spec import COLOURS, HOGSpec
from .taps import pooling_axes


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


def pool(votes: Tensor, spec: HOGSpec) -> Tensor:
    """F^s of Eq. 5-6: votes (B, bins, H, W) to cell histograms (B, bins, rows, cols).  Linear."""
    height, width = votes.shape[-2:]
    rows, cols = pooling_axes(spec, height, width, votes)
    return rows.pool(cols.pool(votes, -1), -2)


def histograms_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, colours · bins, rows, cols)."""
    if spec.colours > 1:
        cells = histograms_reference(separate_colours(images), spec.single_colour)
        return cells.reshape(-1, spec.colours * spec.bins, *cells.shape[2:])
    with torch.autocast(images.device.type, enabled=False):  # its half precision would show in every library's parity
        gx, gy = gradient(spread_nan(_scaled(images, spec), images), spec)  # Eq. 1-2
        return spread_nan(pool(votes(gx, gy, spec), spec), images)  # Eq. 3-6


def normalize_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    cells = histograms.reshape(-1, spec.bins, *histograms.shape[2:])
    with torch.autocast(histograms.device.type, enabled=False):
        descriptor = spec.normalizer.normalize(cells, spec.signed)
    return descriptor.reshape(-1, spec.channels, *descriptor.shape[2:])


def separate_colours(images: Tensor) -> Tensor:
    """Images (B, 1 or 3, H, W) as (3 B, 1, H, W); a pixel that is not finite makes all colours of its image NaN."""
    return spread_nan(images, images).expand(-1, COLOURS, -1, -1).reshape(-1, 1, *images.shape[2:])


def merge_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """From (B · colours, rows, cols, channels) to (B, rows, cols, colours · channels)."""
    return descriptors.reshape(-1, spec.colours, *descriptors.shape[1:]).movedim(1, 3).flatten(3)


def split_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """The inverse of :func:`merge_colours`."""
    batch, rows, cols, channels = descriptors.shape
    colours = descriptors.reshape(batch, rows, cols, spec.colours, channels // spec.colours)
    return colours.movedim(3, 1).flatten(0, 1)
