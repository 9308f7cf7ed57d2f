"""Eq. 1-2: from an image to one gradient (Gx, Gy) a pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ..runtime.pytorch import to_float64
from .spec import Border, HOGSpec

GRAY_WEIGHTS = (0.299, 0.587, 0.114)  # Eq. 1
BLACK = 1e-9  # values up to this count as black: second derivatives of their roots overflow a float32
_GROUP = 8  # columns that dlib computes at a time


class BorderRule(NamedTuple):
    """The derivative across the image border, of Eq. 2."""

    times: int = 0  # how often the difference to the value beyond the border counts; 0: the derivative is 0
    beyond: float | None = None  # that value, in 0…1; None for the outermost pixel's own


# "ignore": the ring is left out when votes are pooled
BORDERS: dict[Border, BorderRule] = {
    "reflect": BorderRule(),
    "ignore": BorderRule(),
    "replicate": BorderRule(1),
    "extrapolate": BorderRule(2),
    "zero": BorderRule(1, 0.0),
    "gray": BorderRule(1, 128 / 255),
}


def _gray_weights(channels: int) -> tuple[float, ...]:
    """Weights of Eq. 1: three channels are R, G, B; any other number is averaged."""
    return GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels


def channel_weights(spec: HOGSpec, channels: int) -> tuple[bool, tuple[float, ...]]:
    """Whether the channels are averaged (Eq. 1) instead of compared by magnitude, and their weights."""
    if spec.colour != "gray" or channels == 1:
        return False, (1.0,) * channels
    return True, _gray_weights(channels)


def gray(image: Tensor) -> Tensor:
    """Eq. 1: (B, C, H, W) to (B, 1, H, W).  One channel passes."""
    weights = _gray_weights(image.shape[1])
    if len(weights) == 1:
        return image
    # pixel by pixel: a matrix product may round equal pixels differently, and a flat area must have a zero gradient
    total = weights[0] * image[:, :1]
    for k in range(1, len(weights)):
        total = total + weights[k] * image[:, k : k + 1]
    return total


def _difference(image: Tensor, dim: int, spec: HOGSpec) -> Tensor:
    """The mask [-1, 0, 1] along ``dim`` (-1: x, -2: y), same shape as the image."""
    n = image.shape[dim]
    if n == 1:
        return image - image  # under every border rule, the two neighbours of a lone pixel are equal
    central = image.narrow(dim, 2, n - 2) - image.narrow(dim, 0, n - 2)
    rule = BORDERS[spec.border]
    if rule.times == 0:
        first = last = torch.zeros_like(image.narrow(dim, 0, 1))
    elif rule.beyond is None:
        first = rule.times * (image.narrow(dim, 1, 1) - image.narrow(dim, 0, 1))
        last = rule.times * (image.narrow(dim, n - 1, 1) - image.narrow(dim, n - 2, 1))
    else:
        beyond = rule.beyond * spec.value_range
        first, last = image.narrow(dim, 1, 1) - beyond, beyond - image.narrow(dim, n - 2, 1)
    return torch.cat([first, central, last], dim)


def _smoothed(image: Tensor, dim: int) -> Tensor:
    """[1, 2, 1] along ``dim``, as if the image were mirrored at its outermost pixels."""
    n = image.shape[dim]
    if n == 1:
        return 4 * image
    before = torch.cat([image.narrow(dim, 1, 1), image.narrow(dim, 0, n - 1)], dim)
    after = torch.cat([image.narrow(dim, 1, n - 1), image.narrow(dim, n - 2, 1)], dim)
    return before + 2 * image + after


def _root(image: Tensor) -> Tensor:
    """√ of each value, with derivative 0 at 0.

    Correctly rounded, which PyTorch's on a CPU is not: differences of roots, and bins, depend on the last digit.
    """
    dark = image <= BLACK
    safe = to_float64(torch.where(dark, 1, image))
    root = torch.sqrt(safe)
    if safe.dtype == image.dtype:
        root = root + _correction(safe.detach(), root.detach())
    return torch.where(dark, 0.0, root).to(image.dtype)


def _correction(value: Tensor, root: Tensor) -> Tensor:
    """``root`` plus this is the number nearest to √value, by the exact residual (Veltkamp, Dekker)."""
    big = (2.0**27 + 1 if value.dtype == torch.float64 else 2.0**12 + 1) * root
    high = big - (big - root)
    low = root - high
    residual = ((value - high * high) - 2 * high * low) - low * low
    return (root + residual / (2 * root)) - root


def last_of_equals(spec: HOGSpec, height: int, width: int) -> npt.NDArray[np.bool_]:
    """(width,): the columns where the last of several channels of equal magnitude counts, not the first."""
    column = np.arange(width)
    if spec.colour_ties == "opencv":
        return column >= width // 4 * 4
    if spec.colour_ties == "dlib":
        votes = min(spec.cells(height, width)[1] * spec.cell_size[1], width) - 2  # columns 1 … votes
        return (column >= 1) & (column <= votes // _GROUP * _GROUP)
    return np.zeros(width, np.bool_)


def _winner(squared: Tensor, spec: HOGSpec) -> Tensor:
    """The channel (B, 1, H, W) of largest magnitude; among equal ones, that of ``spec.colour_ties``."""
    # max, unlike argmax on some devices, is documented to return the first of equal maxima
    first = squared.max(dim=1, keepdim=True).indices
    if spec.colour_ties == "first":
        return first
    last = squared.shape[1] - 1 - squared.flip(1).max(dim=1, keepdim=True).indices
    return torch.where(torch.from_numpy(last_of_equals(spec, *squared.shape[2:])).to(squared.device), last, first)


def gradient(image: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Gx, Gy of Eq. 2, each (B, H, W), of an image (B, C, H, W) in 0…``spec.value_range``.

    Linear in the image for ``colour="gray"``.  For ``"largest"`` it follows the winning channel: piecewise linear, with
    a jump where the winner changes.  Images of dialects with separate colours have one channel.
    """
    if spec.gamma == "sqrt":
        image = _root(image)
    if spec.colour == "gray":
        image = gray(image)
    gx, gy = _difference(image, -1, spec), _difference(image, -2, spec)
    if spec.mask == "sobel":
        gx, gy = _smoothed(gx, -2), _smoothed(gy, -1)
    if image.shape[1] > 1:
        winner = _winner((gx * gx + gy * gy).detach(), spec)
        gx, gy = gx.gather(1, winner), gy.gather(1, winner)
    return gx.squeeze(1), gy.squeeze(1)
