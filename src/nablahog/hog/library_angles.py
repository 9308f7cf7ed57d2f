"""The inexact angles of gradients that libraries use for linear votes."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from .spec import HOGSpec

# OpenCV ``core/src/mathfuncs_core``: atan(t) of t in 0…1, an odd polynomial, in radians
_OPENCV = (0.9997878412794807, -0.3258083974640975, 0.1555786518463281, -0.04432655554792128)
VLFEAT_LEAST = 1e-10  # VLFeat's least magnitude


def opencv_table(spec: HOGSpec) -> tuple[float, ...]:
    """Its four coefficients in degrees, the guard of its division, a degree in radians, and bins by radian: float32."""
    degrees = [p * 180 / math.pi for p in _OPENCV]
    guard = torch.finfo(torch.float64).eps
    return tuple(float(np.float32(x)) for x in (*degrees, guard, math.pi / 180, spec.bins / spec.period))


def opencv(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """OpenCV's position of gradients (B, H, W) among bin centres, in bins, not wrapped; in float32 throughout.

    Its angle, in degrees first, errs by up to 3e-4 rad, and the rounding of positions up to 18 by a millionth of a bin.
    """
    p1, p3, p5, p7, guard, radian, per_radian = opencv_table(spec)
    x, y = gx.float(), gy.float()
    small, large = torch.minimum(x.abs(), y.abs()), torch.maximum(x.abs(), y.abs())
    t = small / (large + guard)
    s = t * t
    angle = (((p7 * s + p5) * s + p3) * s + p1) * t
    angle = torch.where(y.abs() > x.abs(), 90 - angle, angle)
    angle = torch.where(x < 0, 180 - angle, angle)
    angle = torch.where(y < 0, 360 - angle, angle)
    bins: Tensor = angle * radian * per_radian - spec.bin_offset
    return bins.to(gx.dtype)


def vlfeat_directions(spec: HOGSpec) -> npt.NDArray[np.float32]:
    """(cos, sin) of the axes that VLFeat's bins are centred at, (2, axes)."""
    axes = spec.bins // 2 if spec.signed else spec.bins
    centres = np.arange(axes) * math.pi / axes
    return np.stack([np.cos(centres), np.sin(centres)]).astype(np.float32)


def vlfeat(gx: Tensor, gy: Tensor, candidates: Tensor, spec: HOGSpec) -> Tensor:
    """VLFeat's weights of the ``candidates`` (B, 3, H, W), bins, for gradients (B, H, W).

    The bin direction nearest by dot product gets 1 - w, the one next to nearest w: the arccosine of a float32 close to
    1, in units of a bin.
    """
    axes = spec.bins // 2 if spec.signed else spec.bins
    x, y = gx.float(), gy.float()
    # PyTorch's root of a float32 is not the nearest one, and near 1 the arccosine would show it
    length = (x * x + y * y).double().sqrt().float().double().clamp(min=VLFEAT_LEAST)
    cos, sin = torch.from_numpy(vlfeat_directions(spec)).to(x.device).unsqueeze(2).unsqueeze(3)
    dots = x.unsqueeze(1) * cos + y.unsqueeze(1) * sin
    best = dots.abs().max(dim=1, keepdim=True)
    others = dots.abs().scatter(1, best.indices, -1.0)
    second = others.max(dim=1, keepdim=True).indices
    cosine = (best.values / length.unsqueeze(1)).clamp(max=1).float()
    of_second = (torch.acos(cosine).double() / (math.pi / axes)).float()
    nearest, next_ = best.indices, second
    if spec.signed:
        nearest, next_ = (torch.where(dots.gather(1, k) < 0, k + axes, k) for k in (nearest, next_))
    weights: Tensor = (candidates == nearest) * (1 - of_second) + (candidates == next_) * of_second
    return weights.to(gx.dtype)
