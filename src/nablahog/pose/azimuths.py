"""The circle of azimuths, in degrees: equidistant ones, maxima on it, and what many views agree on."""

from __future__ import annotations

import torch
from torch import Tensor

_AGREED = 0.8  # of calibrated similarity: a view that has so much less counts a factor e less
_BLUR = 8.0  # degrees


def equidistant_azimuths(count: int, first: float = 0.0) -> Tensor:
    """All around, (count,), float64, degrees."""
    return first + torch.arange(count, dtype=torch.float64) * (360 / count)


def azimuth_sweep(pose: Tensor, views: int) -> Tensor:
    """``views`` equidistant azimuths from a pose (6,) on, (views, 6); all else stays."""
    poses = pose.repeat(views, 1)
    poses[:, 0] += equidistant_azimuths(views)
    return poses


def azimuth_distance(one: float, other: float) -> float:
    """Degrees between azimuths, in 0…180."""
    return abs((one - other + 180) % 360 - 180)


def local_maxima(values: Tensor, count: int) -> Tensor:
    """Indices of the at most ``count`` highest local maxima on a circle of values (N,), the highest first."""
    highest = (values >= values.roll(1)) & (values >= values.roll(-1))
    indices = highest.nonzero().squeeze(1)
    order: Tensor = indices[values[indices].argsort(descending=True)]
    return order[:count]


def consensus(azimuths: Tensor, similarities: Tensor) -> Tensor:
    """Votes of views of several models for each whole degree of azimuth, (360,).

    A view has the weight exp(similarity / 0.8), blurred by 8°.

    Args:
        azimuths: (N,), degrees.
        similarities: (N,), calibrated.
    """
    weights = torch.exp((similarities - similarities.max()) / _AGREED).to(azimuths)
    degrees = torch.arange(360, dtype=azimuths.dtype)
    apart = (degrees[:, None] - azimuths + 180) % 360 - 180
    return torch.exp(-0.5 * (apart / _BLUR) ** 2) @ weights
