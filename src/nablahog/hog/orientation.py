"""Eq. 2-4: from gradients to votes into orientation bins."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from .spec import HOGSpec


def vanishing(dtype: torch.dtype) -> float:
    """Squared magnitudes below this count as 0, for their reciprocal's square would overflow in a derivative.

    In float32 that is a gradient of 3e-10, a hundred-thousandth of the rounding error of a gray value.
    """
    return math.sqrt(torch.finfo(dtype).tiny)


def _vanishes(squared: Tensor) -> Tensor:
    return squared < vanishing(squared.dtype)


def magnitude(gx: Tensor, gy: Tensor) -> Tensor:
    """‖∇‖ of Eq. 2.  Its derivative at a zero gradient, the tip of a cone, is 0."""
    squared = gx * gx + gy * gy
    zero = _vanishes(squared)
    return torch.where(zero, 0.0, torch.sqrt(torch.where(zero, 1.0, squared)))


def direction(gx: Tensor, gy: Tensor) -> Tensor:
    """Θ of Eq. 2 in radians, (-π, π].  Its value and derivative at a zero gradient are 0."""
    zero = _vanishes(gx * gx + gy * gy)
    return torch.atan2(torch.where(zero, 0.0, gy), torch.where(zero, 1.0, gx))


def _linear_votes(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 3-4, as three candidate bins a pixel: the nearest, the one before, the one after.

    With r the distance to the nearest centre in bins, the triangle of Eq. 3 weighs them 1 - |r|, (|r| - r)/2 and
    (|r| + r)/2; one of the last two is 0.  Written with |r|, whose derivative at 0 is 0, every derivative at a bin
    centre is the mean of the two one-sided ones.
    """
    # divided first: a right angle is then exactly a quarter of a turn, and on a bin centre if the bins say so
    position = direction(gx, gy) / spec.period * spec.bins - spec.bin_offset
    nearest = position.detach().round()
    r = position - nearest
    a = r.abs()
    weights = torch.stack([1 - a, (a - r) / 2, (a + r) / 2], dim=1)
    # clamp only matters for NaN, whose integer is arbitrary: the vote is NaN, the bin must exist
    bin_ = nearest.remainder(spec.bins).long().clamp(0, spec.bins - 1)
    after = torch.where(bin_ == spec.bins - 1, 0, bin_ + 1)
    before = torch.where(bin_ == 0, spec.bins - 1, bin_ - 1)
    bins = torch.stack([bin_, before, after], dim=1)
    votes = gx.new_zeros((gx.shape[0], spec.bins, *gx.shape[1:]))
    return votes.scatter_add_(1, bins, weights * magnitude(gx, gy).unsqueeze(1))


def hard_directions(spec: HOGSpec) -> npt.NDArray[np.float32]:
    """(cos, sin) of the bin centres, (2, axes): of half of them where bins are signed, the others being opposite.

    In float32, as VLFeat's: an exactly vertical gradient ties between two bins in 8-bit images.
    """
    axes = spec.bins // 2 if spec.signed else spec.bins
    angles = (np.arange(axes) + spec.bin_offset) * math.pi / axes
    return np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32)


def _hard_votes(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """The whole magnitude to the bin direction of largest |dot product|, the first on ties, as in VLFeat and DPM."""
    cos, sin = torch.from_numpy(hard_directions(spec)).to(gx).unsqueeze(2).unsqueeze(3)
    dots = gx.detach().unsqueeze(1) * cos + gy.detach().unsqueeze(1) * sin
    bins = dots.abs().max(dim=1, keepdim=True).indices
    if spec.signed:
        bins = torch.where(dots.gather(1, bins) < 0, bins + spec.bins // 2, bins)
    votes = gx.new_zeros((gx.shape[0], spec.bins, *gx.shape[1:]))
    return votes.scatter_add_(1, bins, magnitude(gx, gy).unsqueeze(1))


def votes(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """F^o of Eq. 4: gradients (B, H, W) to weighted votes (B, bins, H, W).

    Linear votes are continuous in the gradient.  Hard votes jump where the winning bin changes; their derivative is
    that of the magnitude, at a fixed bin.
    """
    return _linear_votes(gx, gy, spec) if spec.vote == "linear" else _hard_votes(gx, gy, spec)
