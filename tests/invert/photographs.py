"""Photographs for the tests, from those scikit-image installs."""

from __future__ import annotations

import functools

import torch
from skimage import data
from torch import Tensor
from torch.nn.functional import interpolate


@functools.cache
def photograph(size: int = 64, name: str = "camera") -> Tensor:
    """(1, 1, size, size) in 0…1, float32, 8-bit levels."""
    picture = torch.from_numpy(getattr(data, name)()).float()
    if picture.dim() == 3:
        picture = picture[..., :3] @ torch.tensor([0.299, 0.587, 0.114])
    side = min(picture.shape)
    square = interpolate(picture[None, None, :side, :side], size=(size, size), mode="area")
    return square.round() / 255


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])
