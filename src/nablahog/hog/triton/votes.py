"""Eq. 2-4 in Triton: gradients to votes.

Each rule returns, of a tile of gradients, four tensors: a pixel of magnitude m gives (1 - f) · m to the bin ``low`` and
f · m to the bin after it; the angle that derivatives are taken of lies between the bin ``from_bin`` and the bin after
it, ``part`` of the way, 0 where it is a bin's centre.  Of hard votes f is 0.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import root


@triton.jit
def magnitude(gx, gy):
    """‖∇‖ of Eq. 2 and its reciprocal, or 0 and 0 where the square of that would overflow."""
    least: tl.constexpr = 1.4916681462400413e-154 if gx.dtype == tl.float64 else 1.0842021724855044e-19
    squared = tl.fma(gx, gx, gy * gy)
    inverse = 1 / tl.sqrt(squared) if gx.dtype == tl.float64 else tl.rsqrt(squared)
    inverse = tl.where(squared < least, 0.0, inverse)
    return squared * inverse, inverse


@triton.jit
def _arctangent(t):
    """atan(t) / π of t in 0…1, in float64: a rational function of Cephes (Moshier), after a reduction above 0.66."""
    far = t > 0.66
    u = tl.where(far, (t - 1) / (t + 1), t)
    z = u * u
    p = (((-0.8750608600031904 * z - 16.157537187333652) * z - 75.00855792314705) * z - 122.88666844901361) * z
    q = ((((z + 24.858464901423062) * z + 165.02700983169885) * z + 432.88106049129027) * z + 485.3903996359137) * z
    arc = u + u * z * (p - 64.85021904942025) / (q + 194.5506571482614)
    return tl.where(far, 0.25, 0.0) + arc * 0.3183098861837907


@triton.jit
def _arcsine(t):
    """asin(t) / π of t in 0…√½, in float32: an odd polynomial within 7e-9."""
    s = t * t
    p = tl.fma(s, 0.034910313122062574, -0.02867533338793479)
    p = tl.fma(p, s, 0.024045050441502305)
    p = tl.fma(p, s, 0.0053257665125200065)
    p = tl.fma(p, s, 0.014795313902273344)
    p = tl.fma(p, s, 0.02383540855707664)
    p = tl.fma(p, s, 0.053052564545503686)
    return t * tl.fma(p, s, 0.31830988259045284)


@triton.jit
def _turned(x, sign):
    """-x where the sign bit of ``sign`` is set."""
    bits: tl.constexpr = tl.int64 if x.dtype == tl.float64 else tl.int32
    least: tl.constexpr = -(2**63) if x.dtype == tl.float64 else -(2**31)
    turned = x.to(bits, bitcast=True) ^ (sign.to(bits, bitcast=True) & least)
    return turned.to(x.dtype, bitcast=True)


@triton.jit
def _half_turns(u, v, inverse, SIGNED: tl.constexpr, DIAGONALS: tl.constexpr):
    """The angle of (u, v) in -1…1, or that of the line in -½…½; ``inverse`` is 1 / ‖(u, v)‖.

    Right angles are exact, for they may be bin centres; so are ``DIAGONALS``, their halves.
    """
    au, av = tl.abs(u), tl.abs(v)
    small, large = tl.minimum(au, av), tl.maximum(au, av)
    double: tl.constexpr = u.dtype == tl.float64
    arc = _arctangent(small / tl.where(large > 0, large, 1.0)) if double else _arcsine(small * inverse)
    if DIAGONALS:
        arc = tl.where(au == av, 0.25, arc)
    arc = tl.where(av > au, 0.5 - arc, arc)
    if SIGNED:
        arc = tl.where(u < 0, 1 - arc, arc)
    else:
        v = _turned(v, u)
    return _turned(arc, v)


@triton.jit
def bin_after(bins, VOTING: tl.constexpr):
    return tl.where(bins == VOTING.bins - 1, 0, bins + 1)


@triton.jit
def bin_before(bins, VOTING: tl.constexpr):
    return tl.where(bins == 0, VOTING.bins - 1, bins - 1)


@triton.jit
def _between(position, VOTING: tl.constexpr):
    """The bin at or before a position in -bins…bins, and how far behind its centre the position is."""
    before = tl.floor(position)
    low = before.to(tl.int32)
    return tl.where(low < 0, low + VOTING.bins, low), position - before


@triton.jit
def _position(gx, gy, inverse, VOTING: tl.constexpr):
    """Position by the angle of Eq. 2, in bins: at most half of them, less the offset, from 0."""
    v = -gy if VOTING.counterclockwise else gy
    half_turns = _half_turns(gx, v, inverse, VOTING.signed, VOTING.diagonals)
    per_half_turn = tl.full([], VOTING.bins_per_half_turn, gx.dtype)
    return tl.fma(half_turns, per_half_turn, tl.full([], -VOTING.offset, gx.dtype))


@triton.jit
def linear_votes(gx, gy, inverse, VOTING: tl.constexpr):
    """Votes by the angle of Eq. 2."""
    low, f = _between(_position(gx, gy, inverse, VOTING), VOTING)
    return low, f, low, f


EVEN_64 = tl.constexpr(1.5 * 2.0**53)
EVEN_32 = tl.constexpr(1.5 * 2.0**24)
"""Numbers of about this size are even: what is added to them is rounded to an even number."""


@triton.jit
def votes_of_even_and_odd(gx, gy, VOTING: tl.constexpr):
    """Those of :func:`linear_votes`, for the nearest even bin and for the nearest odd one, less arithmetic.

    Returns the even bin, its vote, the bin before the odd one, the odd one's vote.  Bins, EVEN_32 or EVEN_64 more than
    they are, go from ``VOTING.lowest`` to ``VOTING.highest``.
    """
    zero: tl.constexpr = EVEN_64 if gx.dtype == tl.float64 else EVEN_32
    m, inverse = magnitude(gx, gy)
    position = _position(gx, gy, inverse, VOTING)
    even = position + zero
    odd_vote = tl.abs(position - (even - zero)) * m
    return even, m - odd_vote, (position - 1) + zero, odd_vote


@triton.jit
def opencv_votes(gx, gy, inverse, VOTING: tl.constexpr):
    """Votes by OpenCV's arctangent, in float32: :func:`nablahog.hog.orientation.opencv_angle`."""
    p1, p3, p5, p7 = VOTING.opencv[0], VOTING.opencv[1], VOTING.opencv[2], VOTING.opencv[3]
    u, v = gx.to(tl.float32), gy.to(tl.float32)
    au, av = tl.abs(u), tl.abs(v)
    t = tl.div_rn(tl.minimum(au, av), tl.maximum(au, av) + VOTING.opencv[4])
    s = t * t
    angle = (((p7 * s + p5) * s + p3) * s + p1) * t
    angle = tl.where(av > au, 90 - angle, angle)
    angle = tl.where(u < 0, 180 - angle, angle)
    angle = tl.where(v < 0, 360 - angle, angle)
    position = (angle * VOTING.opencv[5] * VOTING.opencv[6] - VOTING.offset).to(gx.dtype)
    before = tl.floor(position)
    low = (before.to(tl.int32) + 3 * VOTING.bins) % VOTING.bins  # from half a turn below 0 to two above
    return low, position - before, low, position - before


@triton.jit
def _arccosine(c):
    """acos(c) of c in 0.86…1, in float32: 2 · asin(√((1 - c) / 2)) by its series."""
    z = (1 - c) * 0.5
    p = tl.fma(z, 0.022372159090909, 0.030381944444444)
    p = tl.fma(p, z, 0.044642857142857)
    p = tl.fma(p, z, 0.075)
    p = tl.fma(p, z, 0.166666666666667)
    s = root(z)
    return 2 * tl.fma(p * z, s, s)


@triton.jit
def vlfeat_votes(gx, gy, inverse, VOTING: tl.constexpr):
    """Votes by VLFeat's arccosine, in float32: :func:`nablahog.hog.orientation.vlfeat_weights`."""
    axes: tl.constexpr = VOTING.axes
    u, v = gx.to(tl.float32), gy.to(tl.float32)
    length = root(u * u + v * v)
    zero = tl.zeros_like(u)
    largest, second = zero - 1, zero - 1
    own, other = zero.to(tl.int32), zero.to(tl.int32)
    for k in tl.static_range(axes):  # the first of equals
        dot = u * VOTING.table[k] + v * VOTING.table[axes + k]
        size = tl.abs(dot)
        bins = tl.where((dot < 0) & VOTING.signed, k + axes, k)
        better, next_ = size > largest, size > second
        other = tl.where(better, own, tl.where(next_, bins, other))
        second = tl.where(better, largest, tl.where(next_, size, second))
        own, largest = tl.where(better, bins, own), tl.where(better, size, largest)
    is_nonzero = length > 0
    cosine = tl.where(is_nonzero, tl.div_rn(largest, tl.where(is_nonzero, length, 1.0)), 1.0)
    to_other = tl.div_rn(_arccosine(tl.minimum(cosine, 1.0)), zero + VOTING.between_axes).to(gx.dtype)
    ahead = other == bin_after(own, VOTING)
    _, _, from_bin, part = linear_votes(gx, gy, inverse, VOTING)
    return tl.where(ahead, own, other), tl.where(ahead, to_other, 1 - to_other), from_bin, part


@triton.jit
def nearest_votes(gx, gy, inverse, VOTING: tl.constexpr):
    """Hard votes for the largest |dot product| with the bin directions, the first on ties."""
    axes: tl.constexpr = VOTING.axes
    zero = tl.zeros_like(gx)
    largest, own = zero - 1, zero.to(tl.int32)
    for k in tl.static_range(axes):
        dot = gx * VOTING.table[k] + gy * VOTING.table[axes + k]
        better = tl.abs(dot) > largest
        bins = tl.where((dot < 0) & VOTING.signed, k + axes, k)
        own, largest = tl.where(better, bins, own), tl.where(better, tl.abs(dot), largest)
    return own, zero, own, zero


@triton.jit
def begun_votes(gx, gy, inverse, VOTING: tl.constexpr):
    """Hard votes for the bin in whose interval [begin, end) the angle is, by cross products."""
    bins: tl.constexpr = VOTING.bins
    u, v = gx, -gy if VOTING.counterclockwise else gy
    lower = (v < 0) | ((v == 0) & (u < 0))  # of the half-plane of angles in [π, 2π)
    if not VOTING.signed:
        u, v = tl.where(lower, -u, u), tl.where(lower, -v, v)
        lower = lower & (v != v)
    begun = tl.zeros_like(gx).to(tl.int32)
    for k in tl.static_range(bins):
        ahead = v * VOTING.table[k] - u * VOTING.table[bins + k] >= 0
        if VOTING.table[2 * bins + k] > 0:  # a beginning in [0, π)
            begun += (ahead | lower).to(tl.int32)
        else:
            begun += (ahead & lower).to(tl.int32)
    own = (begun + VOTING.before) % bins
    zero = tl.zeros_like(gx)
    return own, zero, own, zero
