"""Eq. 2-4: from gradients to votes into orientation bins."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ..runtime.pytorch import to_float64
from .spec import Angle, Boundary, HOGSpec

Shares: TypeAlias = tuple[Tensor, Tensor | int]
_SLACK = 1e-9  # radians
# OpenCV ``core/src/mathfuncs_core``: atan(t) of t in 0…1, an odd polynomial, in radians
_OPENCV_ARCTANGENT = (0.9997878412794807, -0.3258083974640975, 0.1555786518463281, -0.04432655554792128)
VLFEAT_LEAST = 1e-10  # VLFeat's least magnitude


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


def bin_angles(spec: HOGSpec) -> npt.NDArray[np.float64]:
    """The directions (bins,) of gradients that the bins are centred at, in radians."""
    centres = (np.arange(spec.bins, dtype=np.float64) + spec.bin_offset) * (spec.period / spec.bins)
    return -centres if spec.counterclockwise else centres


def _position(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """The exact position of gradients among bin centres, in bins: 0 at the centre of bin 0, 1 at that of bin 1."""
    # divided first: a right angle is then exactly a quarter of a turn, and on a bin centre if the bins say so
    turned = direction(gx, gy) / spec.period
    return (-turned if spec.counterclockwise else turned) * spec.bins - spec.bin_offset


def _shares(nearest: Tensor, r: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Eq. 3-4, as three candidate bins a pixel, (B, 3, H, W), and the weights of its vote in these.

    The candidates are the nearest bin, the one before, the one after.  With r the distance to the nearest centre in
    bins, the triangle of Eq. 3 weighs them 1 - |r|, (|r| - r)/2 and (|r| + r)/2; one of the last two is 0.  Written
    with |r|, whose derivative at 0 is 0, every derivative at a bin centre is the mean of the two one-sided ones.
    """
    a = r.abs()
    # a constant 0 on the other side: the gradient of that bin may be huge, and half of it minus half of it is not 0
    before, after = torch.where(r > 0, 0.0, (a - r) / 2), torch.where(r < 0, 0.0, (a + r) / 2)
    weights = torch.stack([1 - a, before, after], dim=1)
    # clamp only matters for NaN, whose integer is arbitrary: the vote is NaN, but the bin must exist
    bin_ = nearest.remainder(spec.bins).long().clamp(0, spec.bins - 1)
    bin_after = torch.where(bin_ == spec.bins - 1, 0, bin_ + 1)
    bin_before = torch.where(bin_ == 0, spec.bins - 1, bin_ - 1)
    return torch.stack([bin_, bin_before, bin_after], dim=1), weights


def _exact_shares(gx: Tensor, gy: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Shares by the angle of Eq. 2."""
    position = _position(gx, gy, spec)
    nearest = position.detach().round()
    return _shares(nearest, position - nearest, spec)


def opencv_table(spec: HOGSpec) -> tuple[float, ...]:
    """Its four coefficients in degrees, the guard of its division, a degree in radians, and bins by radian: float32."""
    degrees = [p * 180 / math.pi for p in _OPENCV_ARCTANGENT]
    guard = torch.finfo(torch.float64).eps
    return tuple(float(np.float32(x)) for x in (*degrees, guard, math.pi / 180, spec.bins / spec.period))


def opencv_angle(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
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


def _opencv_shares(gx: Tensor, gy: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Shares by OpenCV's arctangent, with the derivative of the exact angle."""
    opencv_position = opencv_angle(gx.detach(), gy.detach(), spec)
    nearest = opencv_position.round()
    r = _position(gx, gy, spec) - nearest
    r = r - spec.bins * (r / spec.bins).detach().round()  # their angles begin elsewhere
    return _shares(nearest, r + (opencv_position - nearest - r).detach(), spec)


def vlfeat_directions(spec: HOGSpec) -> npt.NDArray[np.float32]:
    """(cos, sin) of the axes that VLFeat's bins are centred at, (2, axes)."""
    axes = spec.bins // 2 if spec.signed else spec.bins
    centres = np.arange(axes) * math.pi / axes
    return np.stack([np.cos(centres), np.sin(centres)]).astype(np.float32)


def vlfeat_weights(gx: Tensor, gy: Tensor, candidates: Tensor, spec: HOGSpec) -> Tensor:
    """VLFeat's weights of the ``candidates`` (B, 3, H, W), bins, for gradients (B, H, W).

    The bin direction nearest by dot product gets 1 - w, the one next to nearest w: the arccosine of a float32 close to
    1, in units of a bin.
    """
    axes = spec.bins // 2 if spec.signed else spec.bins
    x, y = gx.float(), gy.float()
    # PyTorch's root of a float32 is not the nearest one, and near 1 the arccosine would show it
    length = to_float64(to_float64(x * x + y * y).sqrt().float()).clamp(min=VLFEAT_LEAST)
    cos, sin = torch.from_numpy(vlfeat_directions(spec)).to(x.device).unsqueeze(2).unsqueeze(3)
    dots = x.unsqueeze(1) * cos + y.unsqueeze(1) * sin
    best = dots.abs().max(dim=1, keepdim=True)
    without_best = dots.abs().scatter(1, best.indices, -1.0)
    second = without_best.max(dim=1, keepdim=True).indices
    cosine = (best.values / length.unsqueeze(1)).clamp(max=1).float()
    share = (to_float64(torch.acos(cosine)) / (math.pi / axes)).float()
    nearest, next_ = best.indices, second
    if spec.signed:
        nearest, next_ = (torch.where(dots.gather(1, k) < 0, k + axes, k) for k in (nearest, next_))
    weights: Tensor = (candidates == nearest) * (1 - share) + (candidates == next_) * share
    return weights.to(gx.dtype)


def _vlfeat_shares(gx: Tensor, gy: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Shares by VLFeat's arccosine, with the derivative of the exact angle."""
    bins, weights = _exact_shares(gx, gy, spec)
    return bins, weights + (vlfeat_weights(gx.detach(), gy.detach(), bins, spec) - weights).detach()


def hard_directions(spec: HOGSpec) -> npt.NDArray[np.float32]:
    """(cos, sin) of the bin centres, (2, axes): of half of them where bins are signed, the others being opposite.

    In float32, as VLFeat's: an exactly vertical gradient ties between two bins in 8-bit images.
    """
    centres = bin_angles(spec)[: spec.bins // 2 if spec.signed else spec.bins]
    table = np.stack([np.cos(centres), np.sin(centres)])
    return (table.round(4) if spec.directions == "four-decimals" else table).astype(np.float32)


def _nearest_axes(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """The bin direction (B, 1, H, W) of largest |dot product|, the first on ties, as in VLFeat and DPM.

    Opposite gradients vote into opposite bins where bins are signed.
    """
    cos, sin = torch.from_numpy(hard_directions(spec)).to(gx).unsqueeze(2).unsqueeze(3)
    dots = gx.unsqueeze(1) * cos + gy.unsqueeze(1) * sin
    bins = dots.abs().max(dim=1, keepdim=True).indices
    return torch.where(dots.gather(1, bins) < 0, bins + spec.bins // 2, bins) if spec.signed else bins


def beginnings(spec: HOGSpec) -> tuple[list[tuple[float, float, bool]], int]:
    """Lower ends of bins, sorted by angle: cos, sin, and whether in the first half turn; and the bin of the first."""
    width = spec.period / spec.bins
    # rounding must not turn a start of 0 into one of a whole period
    starts = [((k + spec.bin_offset - 0.5) * width + _SLACK) % spec.period - _SLACK for k in range(spec.bins)]
    # rounded, so that numbers that should be equal are
    table = [(round(math.cos(start), 12), round(math.sin(start), 12), start < math.pi) for start in sorted(starts)]
    return table, starts.index(min(starts))


def _begun_bins(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """The bin (B, 1, H, W) in whose interval [begin, end) the angle of the gradient is.

    By cross products with the lower ends of all bins, rounded as in the loops: of a gradient that is nearly on a
    boundary both must find the same bin.
    """
    starts, first = beginnings(spec)
    x, y = gx, -gy if spec.counterclockwise else gy
    lower = (y < 0) | ((y == 0) & (x < 0))  # of the half-plane of angles in [π, 2π)
    if not spec.signed:
        x, y = torch.where(lower, -x, x), torch.where(lower, -y, y)
        lower = torch.zeros_like(lower)
    begun = torch.zeros_like(x, dtype=torch.long)
    for cos, sin, early in starts:
        ahead = y * cos - x * sin >= 0
        begun = begun + (ahead | lower if early else ahead & lower)
    return ((begun - 1 + first) % spec.bins).unsqueeze(1)


def _whole(bins: Callable[[Tensor, Tensor, HOGSpec], Tensor]) -> Callable[[Tensor, Tensor, HOGSpec], Shares]:
    """The whole vote to the one bin (B, 1, H, W) that ``bins`` finds."""

    def shares(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Shares:
        return bins(gx.detach(), gy.detach(), spec), 1

    return shares


class VoteRule(NamedTuple):
    """How the vote of a pixel is shared among bins.

    ``shares`` maps gradients (B, H, W) to candidate bins (B, n, H, W) and the weights of the vote in these.
    """

    shares: Callable[[Tensor, Tensor, HOGSpec], Shares]
    name: str  # by which the engines choose their loops
    hard: bool = False  # the whole vote goes to one bin, and its derivative is that of the magnitude
    inexact: bool = False  # the derivative is by another angle than the votes


LINEAR_VOTES: dict[Angle, VoteRule] = {
    "exact": VoteRule(_exact_shares, "linear"),
    "opencv": VoteRule(_opencv_shares, "opencv"),
    "vlfeat": VoteRule(_vlfeat_shares, "vlfeat", inexact=True),
}
HARD_VOTES: dict[Boundary, VoteRule] = {
    "first": VoteRule(_whole(_nearest_axes), "nearest", hard=True),
    "upper": VoteRule(_whole(_begun_bins), "begun", hard=True),
}


def vote_rule(spec: HOGSpec) -> VoteRule:
    """The spec's, by its fields ``vote``, and ``angle`` or ``boundary``."""
    return LINEAR_VOTES[spec.angle] if spec.vote == "linear" else HARD_VOTES[spec.boundary]


def vote_directions(spec: HOGSpec) -> npt.NDArray[np.float64]:
    """Directions that the dialect's rule of votes compares gradients with, (2 or 3, directions): cosines and sines.

    Directions of bins, or where bins begin, and then whether in the first half turn; nothing where votes are by angle.
    """
    rule = vote_rule(spec).name
    if rule == "nearest":
        return hard_directions(spec).astype(np.float64)
    if rule == "vlfeat":
        return vlfeat_directions(spec).astype(np.float64)
    return np.array(beginnings(spec)[0], np.float64).T if rule == "begun" else np.zeros((2, 0))


def votes(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    """F^o of Eq. 4: gradients (B, H, W) to weighted votes (B, bins, H, W).

    Linear votes are continuous in the gradient.  Hard votes jump where the winning bin changes; their derivative is
    that of the magnitude, at a fixed bin, or, if the spec says so, that of linear votes.
    """
    rule = vote_rule(spec)
    cast = _cast(gx, gy, rule, spec)
    if spec.derivative == "own" or not rule.hard:
        return cast
    # not by a spec with linear votes: torch.compile cannot trace the making of one
    linear = _cast(gx, gy, LINEAR_VOTES["exact"], spec)
    return linear - linear.detach() + cast.detach()


def _cast(gx: Tensor, gy: Tensor, rule: VoteRule, spec: HOGSpec) -> Tensor:
    bins, weights = rule.shares(gx, gy, spec)
    empty = gx.new_zeros((gx.shape[0], spec.bins, *gx.shape[1:]))
    return empty.scatter_add_(1, bins, weights * magnitude(gx, gy).unsqueeze(1))
