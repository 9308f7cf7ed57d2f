"""Colours that are described separately: each as an image of one channel."""

from __future__ import annotations

import torch
from torch import Tensor

from .spec import COLOURS, HOGSpec
from .steps import spread_nan


def separate_colours(images: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, C, H, W), or if colours are described separately, (B · colours, 1, H, W).

    There, a pixel that is not finite makes all colours of its image NaN.
    """
    if images.dtype == torch.uint8 and torch.get_default_dtype() == torch.float64:
        images = images.double() / 255
    if spec.colours == 1:
        return images
    return spread_nan(images, images).expand(-1, COLOURS, -1, -1).reshape(-1, 1, *images.shape[2:])


def merge_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """From (B · colours, rows, cols, channels) to (B, rows, cols, colours · channels)."""
    if spec.colours == 1:
        return descriptors
    return descriptors.reshape(-1, spec.colours, *descriptors.shape[1:]).movedim(1, 3).flatten(3)


def split_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """The inverse of :func:`merge_colours`, and its vjp."""
    if spec.colours == 1:
        return descriptors
    batch, rows, cols, channels = descriptors.shape
    each = descriptors.reshape(batch, rows, cols, spec.colours, channels // spec.colours)
    return each.movedim(3, 1).flatten(0, 1)


def separate_colours_vjp(grad_output: Tensor, channels: int, spec: HOGSpec) -> Tensor:
    """The vjp of :func:`separate_colours`, of images of so many channels."""
    if spec.colours == 1:
        return grad_output
    each = grad_output.reshape(-1, spec.colours, *grad_output.shape[2:])
    return each if channels == COLOURS else each.sum(dim=1, keepdim=True)
