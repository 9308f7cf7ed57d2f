"""Eq. 2-4 compiled, a line of pixels at a time: what each pixel votes.

With m its magnitude, a pixel gives (1 - f) · m to one bin and f · m to the next; a hard vote has no f.  Pixels whose
squared magnitude is below ``tiny`` have none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compile import compiled
from ..angles import VLFEAT_LEAST
from .plans import LINEAR, NEAREST, OPENCV, VLFEAT

# atan(t) / π for t in 0…1, within 8e-8: an odd polynomial, so that right angles stay exactly on their bin centres
ARCTANGENT = np.array(
    [0.3183086485, -0.1060524763, 0.06305023492, -0.04212303499, 0.02534499976, -0.01069655349, 0.002168260411],
    np.float32,
)


@compiled
def magnitudes(gx: Any, gy: Any, tiny: Any, m: Any) -> None:
    """‖∇‖ of Eq. 2."""
    zero = m.dtype.type(0)
    for x in range(m.size):
        squared = gx[x] * gx[x] + gy[x] * gy[x]
        m[x] = zero if squared < tiny else math.sqrt(squared)


@compiled
def _whole(position: Any, count: Any, zero: Any) -> Any:
    """The bin at or before a position of at most two turns, as a whole number in 0 … count - 1."""
    bin_ = np.floor(position)
    bin_ = bin_ + count if bin_ < zero else bin_
    bin_ = bin_ + count if bin_ < zero else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    return bin_ if bin_ >= zero else zero  # of NaN


@compiled
def linear_single(
    gx: Any,
    gy: Any,
    tiny: Any,
    up: Any,
    per_half_turn: Any,
    offset: Any,
    count: Any,
    arctangent: Any,
    f: Any,
    bins: Any,
) -> None:
    """Linear votes in float32.  ``up`` is -1 if bins go against the clock.

    Without branches, so that several pixels go at a time.
    """
    a0, a1, a2, a3, a4, a5, a6 = arctangent
    one, half, zero = arctangent.dtype.type(1), arctangent.dtype.type(0.5), arctangent.dtype.type(0)
    quarter = half * half
    for x in range(f.size):
        u, v = gx[x], up * gy[x]
        nothing = u * u + v * v < tiny
        au, av = abs(u), abs(v)
        steep = av > au
        small = au if steep else av
        large = av if steep else au
        t = zero if nothing else small / (one if nothing else large)
        s = t * t
        turn = t * (a0 + s * (a1 + s * (a2 + s * (a3 + s * (a4 + s * (a5 + s * a6))))))
        turn = quarter if small == large else turn  # which may be a bin centre, too
        turn = half - turn if steep else turn
        turn = one - turn if u < zero else turn
        turn = -turn if v < zero else turn
        position = (zero if nothing else turn) * per_half_turn - offset
        f[x] = position - np.floor(position)
        bins[x] = np.int32(_whole(position, count, zero))


@compiled
def linear_double(
    gx: Any, gy: Any, tiny: Any, up: Any, per_half_turn: Any, offset: Any, count: Any, f: Any, bins: Any
) -> None:
    """Linear votes in float64."""
    for x in range(f.size):
        u, v = gx[x], up * gy[x]
        turn = 0.0 if u * u + v * v < tiny else math.atan2(v, u) / math.pi
        position = turn * per_half_turn - offset
        f[x] = position - np.floor(position)
        bins[x] = np.int32(_whole(position, count, 0.0))


@compiled
def linear_opencv(gx: Any, gy: Any, table: Any, offset: Any, count: Any, f: Any, bins: Any) -> None:
    """Linear votes by OpenCV's arctangent: :func:`nablahog.hog.angles.opencv`.

    ``table`` holds its coefficients in degrees, the guard of its division, a degree in radians, and bins by radian.
    """
    p1, p3, p5, p7, guard, radian, per_radian = table
    zero, offset, count = np.float32(0), np.float32(offset), np.float32(count)
    right, half, full = np.float32(90), np.float32(180), np.float32(360)
    for x in range(f.size):
        u, v = np.float32(gx[x]), np.float32(gy[x])
        au, av = abs(u), abs(v)
        steep = av > au
        small = au if steep else av
        large = av if steep else au
        t = small / (large + guard)
        s = t * t
        angle = (((p7 * s + p5) * s + p3) * s + p1) * t
        angle = right - angle if steep else angle
        angle = half - angle if u < zero else angle
        angle = full - angle if v < zero else angle
        position = angle * radian * per_radian - offset
        f[x] = position - np.floor(position)
        bins[x] = np.int32(_whole(position, count, zero))


@compiled
def linear_vlfeat(gx: Any, gy: Any, directions: Any, signed: bool, least: Any, f: Any, bins: Any) -> None:
    """Linear votes by VLFeat's arccosine: :func:`nablahog.hog.angles.vlfeat`.  ``least`` is its smallest magnitude."""
    axes = directions.shape[1]
    count = 2 * axes if signed else axes
    for x in range(f.size):
        u, v = np.float32(gx[x]), np.float32(gy[x])
        best, most, second, next_ = 0, np.float32(-1), 0, np.float32(-1)
        for k in range(axes):
            dot = u * directions[0, k] + v * directions[1, k]
            size = abs(dot)
            place = k + axes if signed and dot < 0 else k
            if size > most:
                second, next_ = best, most
                best, most = place, size
            elif size > next_:
                second, next_ = place, size
        length = max(np.float64(np.float32(math.sqrt(u * u + v * v))), least)
        cosine = np.float32(min(np.float64(most) / length, 1.0))
        of_second = np.float32(np.float64(math.acos(cosine)) / (math.pi / axes))
        ahead = second == (best + 1) % count
        bins[x] = best if ahead else second
        f[x] = of_second if ahead else np.float32(1) - of_second


@compiled
def hard_nearest(gx: Any, gy: Any, directions: Any, signed: bool, most: Any, bins: Any) -> None:
    """Hard votes for the largest |dot product| with ``directions`` (cos, sin) (2, axes), the first on ties."""
    axes = directions.shape[1]
    opposite = axes if signed else 0
    most[:] = -1
    bins[:] = 0
    for k in range(axes):
        cos, sin = directions[0, k], directions[1, k]
        for x in range(most.size):
            dot = gx[x] * cos + gy[x] * sin
            size = abs(dot)
            better = size > most[x]
            most[x] = size if better else most[x]
            bins[x] = np.int32(k + (opposite if dot < 0 else 0)) if better else bins[x]


@compiled
def hard_begun(
    gx: Any, gy: Any, up: Any, starts: Any, first: int, count: int, signed: bool, us: Any, vs: Any, bins: Any
) -> None:
    """Hard votes for the last bin at or before whose beginning the gradient points.

    ``starts`` (3, bins): cos and sin of where bins begin, sorted, and whether that is in the first half turn; ``first``
    is the bin that begins first.  ``us`` and ``vs`` are overwritten.  Multiples of 45° are exact; gradients that close
    to another beginning that only rounding tells on which side do not occur in 8-bit images.
    """
    zero, one, none = us.dtype.type(0), np.int32(1), np.int32(0)
    before = np.int32(count - 1 + first)
    for x in range(bins.size):
        u, v = gx[x], up * gy[x]
        back = v < zero or (v == zero and u < zero)
        us[x] = -u if back else u
        vs[x] = -v if back else v
        bins[x] = before
    for k in range(starts.shape[1]):
        cos, sin, early = starts[0, k], starts[1, k], starts[2, k] > 0
        if not signed:
            for x in range(bins.size):
                bins[x] += one if vs[x] * cos - us[x] * sin >= zero else none
        else:
            for x in range(bins.size):
                back = up * gy[x] < zero or (up * gy[x] == zero and gx[x] < zero)
                across = vs[x] * cos - us[x] * sin
                ahead = across <= zero if back else across >= zero
                bins[x] += one if ((ahead or back) if early else (ahead and back)) else none
    turn = np.int32(count)
    for x in range(bins.size):
        bins[x] = bins[x] - turn if bins[x] >= turn else bins[x]
        bins[x] = bins[x] - turn if bins[x] >= turn else bins[x]


@compiled
def linear(gx: Any, gy: Any, voting: Any, f: Any, bins: Any) -> None:
    """Linear votes by the exact angle."""
    args = gx, gy, voting.tiny, voting.up, voting.per_half_turn, voting.offset, voting.count
    if gx.itemsize == 4:
        linear_single(*args, ARCTANGENT, f, bins)
    else:
        linear_double(*args, f, bins)


@compiled
def vote_line(gx: Any, gy: Any, voting: Any, us: Any, vs: Any, m: Any, f: Any, bins: Any) -> None:
    """Votes of a line of gradients by ``voting``, a :class:`.plans.Voting`; ``us`` and ``vs`` are overwritten."""
    magnitudes(gx, gy, voting.tiny, m)
    if voting.kind == LINEAR:
        linear(gx, gy, voting, f, bins)
    elif voting.kind == OPENCV:
        linear_opencv(gx, gy, voting.opencv, voting.offset, voting.count, f, bins)
    elif voting.kind == VLFEAT:
        linear_vlfeat(gx, gy, voting.vlfeat, voting.signed, VLFEAT_LEAST, f, bins)
    elif voting.kind == NEAREST:
        hard_nearest(gx, gy, voting.directions, voting.signed, us, bins)
    else:
        count = np.int32(voting.count)
        hard_begun(gx, gy, voting.up, voting.starts, voting.first, count, voting.signed, us, vs, bins)
