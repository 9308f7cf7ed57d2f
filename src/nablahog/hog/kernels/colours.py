"""Channels that are described separately: each as an image of its own."""

from __future__ import annotations

import torch
from torch import Tensor

from ..spec import COLOURS, HOGSpec


def separate_colours(images: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, C, H, W) whose channels are described together, of separate colours (B · colours, 1, H, W)."""
    if images.dtype == torch.uint8 and torch.get_default_dtype() == torch.float64:
        images = images.double() / 255
    if spec.colours == 1:
        return images
    return images.expand(-1, COLOURS, -1, -1).reshape(-1, 1, *images.shape[2:])


def merge_colours(found: Tensor, spec: HOGSpec) -> Tensor:
    """From (B · colours, rows, cols, channels) to (B, rows, cols, colours · channels)."""
    if spec.colours == 1:
        return found
    return found.reshape(-1, spec.colours, *found.shape[1:]).movedim(1, 3).flatten(3)


def split_colours(given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint of :func:`merge_colours`."""
    if spec.colours == 1:
        return given
    batch, rows, cols, channels = given.shape
    each = given.reshape(batch, rows, cols, spec.colours, channels // spec.colours)
    return each.movedim(3, 1).flatten(0, 1)


def separate_colours_vjp(given: Tensor, channels: int, spec: HOGSpec) -> Tensor:
    """The adjoint of :func:`separate_colours`, to images of so many channels."""
    if spec.colours == 1:
        return given
    each = given.reshape(-1, spec.colours, *given.shape[2:])
    return each if channels == COLOURS else each.sum(dim=1, keepdim=True)
