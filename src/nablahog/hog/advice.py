"""Warnings about images that are valid, but are seldom meant, with what to write instead."""

from __future__ import annotations

import math
import warnings

import numpy as np
import torch
from torch import Tensor
from torch.nn import Parameter

from .spec import COLOURS, HOGSpec

STEP = 8  # every eighth row and column is looked at: values in 0…255 show in any few pixels
BEYOND = 1.0  # above white; filters overshoot by less
_CALLER = 5  # frames up: this file's two, the two of the operator, and the line that called it


def advise(images: Tensor, spec: HOGSpec) -> None:
    """Warns of images (B, C, H, W) whose range or channels are seldom meant; by Python's default filter once a line.

    Traced and fake tensors have no values, and other devices than the CPU are not waited for.
    """
    if torch.compiler.is_compiling() or type(images) not in (Tensor, Parameter):
        return
    channels = images.shape[1]
    if channels == COLOURS + 1:
        _warn(
            "images have 4 channels, and each of them is described; of RGBA images drop the last: write images[:, :3] "
            "for tensors, image.convert('RGB') for PIL"
        )
    if channels == COLOURS and spec.colour == "gray" and spec.layout in ("blocks", "block-vector"):
        _warn(
            "images have 3 channels, which this spec makes gray (Eq. 1); scikit-image refuses them, or takes the "
            "channel of largest gradient: write presets.skimage(channel_axis=-1) for that"
        )
    if images.is_cpu and images.is_floating_point() and _is_beyond(images):
        _warn(
            "images of floats have values far beyond 0…1, where 1 is white: divide those in 0…255 by 255, or pass uint8"
        )


def _is_beyond(images: Tensor) -> bool:
    try:
        values = images.detach().numpy()[..., ::STEP, ::STEP]  # a microsecond, where slices of tensors take four
    except RuntimeError:  # of a transform of torch.func, a dual number, without storage
        return False
    if not values.size:
        return False
    # images that are not finite have no range; of centred ones half is above 0
    return 1 + BEYOND < float(np.maximum.reduce(values, axis=None)) < math.inf


def _warn(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=_CALLER)
