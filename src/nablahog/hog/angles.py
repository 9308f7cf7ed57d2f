"""How libraries measure the angle of a gradient for linear votes: nearly, and these are their errors."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from .spec import HOGSpec

# OpenCV ``core/src/mathfuncs_core``: atan(t) of t in 0…1, an odd polynomial, in radians
_OPENCV = (0.9997878412794807, -0.3258083974640975, 0.1555786518463281, -0.04432655554792128)
_TINY = 1e-10  # VLFeat's least magnitude


def opencv(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """Where OpenCV has gradients (B, H, W) between bin centres, in bins, not wrapped; in float32 throughout.

    Its angle, in degrees first, errs by up to 3e-4 rad, and the rounding of positions up to 18 by a millionth of a bin.
    """
    x, y = gx.float(), gy.float()
    small, large = torch.minimum(x.abs(), y.abs()), torch.maximum(x.abs(), y.abs())
    t = small / (large + torch.finfo(torch.float64).eps)
    s = t * t
    p1, p3, p5, p7 = (float(np.float32(p * 180 / math.pi)) for p in _OPENCV)
    angle = (((p7 * s + p5) * s + p3) * s + p1) * t
    angle = torch.where(y.abs() > x.abs(), 90 - angle, angle)
    angle = torch.where(x < 0, 180 - angle, angle)
    angle = torch.where(y < 0, 360 - angle, angle)
    per_radian = float(np.float32(spec.bins / spec.period))
    return (angle * float(np.float32(math.pi / 180)) * per_radian - spec.bin_offset).to(gx)


def vlfeat(gx: Tensor, gy: Tensor, candidates: Tensor, spec: HOGSpec) -> Tensor:
    """VLFeat's weights of the ``candidates`` (B, 3, H, W), bins, for gradients (B, H, W).

    The bin direction nearest by dot product gets 1 - w, the one next to nearest w: the arccosine of a float32 close to
    1, in units of a bin.
    """
    axes = spec.bins // 2 if spec.signed else spec.bins
    x, y = gx.float(), gy.float()
    # PyTorch's root of a float32 is not the nearest one, and near 1 the arccosine would show it
    length = (x * x + y * y).double().sqrt().float().double().clamp(min=_TINY)
    centres = np.arange(axes) * math.pi / axes
    cos, sin = (
        torch.from_numpy(f(centres).astype(np.float32)).to(x.device).reshape(-1, 1, 1) for f in (np.cos, np.sin)
    )
    dots = x.unsqueeze(1) * cos + y.unsqueeze(1) * sin
    best = dots.abs().max(dim=1, keepdim=True)
    others = dots.abs().scatter(1, best.indices, -1.0)
    second = others.max(dim=1, keepdim=True).indices
    cosine = (best.values / length.unsqueeze(1)).clamp(max=1).float()
    of_second = (torch.acos(cosine).double() / (math.pi / axes)).float()
    nearest, next_ = best.indices, second
    if spec.signed:
        nearest, next_ = (torch.where(dots.gather(1, k) < 0, k + axes, k) for k in (nearest, next_))
    return ((candidates == nearest) * (1 - of_second) + (candidates == next_) * of_second).to(gx)
