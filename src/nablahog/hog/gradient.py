"""Eq. 1-2: from an image to one gradient (Gx, Gy) a pixel."""

from __future__ import annotations

import torch
from torch import Tensor

from .spec import Border, HOGSpec

GRAY_WEIGHTS = (0.299, 0.587, 0.114)  # Eq. 1


def gray(image: Tensor) -> Tensor:
    """Eq. 1: (B, C, H, W) to (B, 1, H, W).  One channel passes; three are R, G, B; any other number is averaged."""
    channels = image.shape[1]
    if channels == 1:
        return image
    weights = GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels
    # pixel by pixel: a matrix product may round equal pixels differently, and a flat area must have a zero gradient
    total = weights[0] * image[:, :1]
    for k in range(1, channels):
        total = total + weights[k] * image[:, k : k + 1]
    return total


def _difference(image: Tensor, dim: int, border: Border) -> Tensor:
    """The mask [-1, 0, 1] along ``dim`` (-1: x, -2: y), same shape as the image."""
    n = image.shape[dim]
    if n == 1:
        return image - image  # by every border rule the two neighbours of a lone pixel are equal
    central = image.narrow(dim, 2, n - 2) - image.narrow(dim, 0, n - 2)
    if border == "replicate":
        first = image.narrow(dim, 1, 1) - image.narrow(dim, 0, 1)
        last = image.narrow(dim, n - 1, 1) - image.narrow(dim, n - 2, 1)
    elif border == "zero":
        first, last = image.narrow(dim, 1, 1), -image.narrow(dim, n - 2, 1)
    else:  # "reflect"; and "ignore", whose ring is left out when votes are pooled
        first = last = torch.zeros_like(image.narrow(dim, 0, 1))
    return torch.cat([first, central, last], dim)


def gradient(image: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Gx, Gy of Eq. 2, each (B, H, W), of an image (B, C, H, W) in 0…``spec.value_range``.

    Linear in the image for ``colour="gray"``.  For ``"largest"`` it follows the winning channel: piecewise linear, with
    a jump where the winner changes.
    """
    if spec.colour == "gray":
        image = gray(image)
    gx, gy = _difference(image, -1, spec.border), _difference(image, -2, spec.border)
    if image.shape[1] > 1:
        # max, unlike argmax on some devices, is documented to return the first of equal maxima
        winner = (gx * gx + gy * gy).detach().max(dim=1, keepdim=True).indices
        gx, gy = gx.gather(1, winner), gy.gather(1, winner)
    return gx.squeeze(1), gy.squeeze(1)
