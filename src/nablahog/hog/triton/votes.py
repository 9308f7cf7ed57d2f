"""Eq. 2-4 in Triton: gradients to votes.

Each rule returns, of a tile of gradients, five tensors: a pixel of magnitude m gives (1 - f) · m to the bin ``own`` and
f · m to the bin ``other``; it is ``r`` bins, of either sign, from the centre of the bin ``near`` by the angle that
derivatives are taken of.  ``table`` holds what :func:`.parameters.voting` wrote for the rule.
"""

from __future__ import annotations

import triton
import triton.language as tl

from .gradients import quotient, root


@triton.jit
def magnitude(gx, gy):
    """‖∇‖ of Eq. 2; 0 where its reciprocal's square would overflow."""
    least: tl.constexpr = 1.4916681462400413e-154 if gx.dtype == tl.float64 else 1.0842021724855044e-19
    squared = gx * gx + gy * gy
    zero = squared < least
    return tl.where(zero, 0.0, root(tl.where(zero, 1.0, squared)))


@triton.jit
def _arctangent_double(t):
    """atan(t) / π of t in 0…1, in float64: a rational function of Cephes (Moshier), after a reduction above 0.66."""
    far = t > 0.66
    u = tl.where(far, (t - 1) / (t + 1), t)
    z = u * u
    p = (((-0.8750608600031904 * z - 16.157537187333652) * z - 75.00855792314705) * z - 122.88666844901361) * z
    q = ((((z + 24.858464901423062) * z + 165.02700983169885) * z + 432.88106049129027) * z + 485.3903996359137) * z
    arc = u + u * z * (p - 64.85021904942025) / (q + 194.5506571482614)
    return tl.where(far, 0.25, 0.0) + arc * 0.3183098861837907


@triton.jit
def _arctangent_single(t):
    """The same in float32: an odd polynomial within 4e-9."""
    s = t * t
    p = tl.fma(s, 0.0009021106843, -0.005094559438)
    p = tl.fma(p, s, 0.01355605648)
    p = tl.fma(p, s, -0.02385874386)
    p = tl.fma(p, s, 0.03385783986)
    p = tl.fma(p, s, -0.04520818603)
    p = tl.fma(p, s, 0.06363805172)
    p = tl.fma(p, s, -0.1061024469)
    return t * tl.fma(p, s, 0.3183098812)


@triton.jit
def _half_turns(u, v):
    """The angle of (u, v) in -1…1; right angles and their halves are exact, for they may be bin centres."""
    au, av = tl.abs(u), tl.abs(v)
    steep = av > au
    small, large = tl.minimum(au, av), tl.maximum(au, av)
    t = quotient(small, tl.where(large > 0, large, 1.0))
    arc = _arctangent_double(t) if t.dtype == tl.float64 else _arctangent_single(t)
    arc = tl.where(small == large, 0.25, arc)
    arc = tl.where(steep, 0.5 - arc, arc)
    arc = tl.where(u < 0, 1 - arc, arc)
    return tl.where(v < 0, -arc, arc)


@triton.jit
def _near(position, VOTING: tl.constexpr):
    """The nearest bin of a position of less than two turns, and the distance from its centre."""
    nearest = tl.floor(position + 0.5)
    bins = (nearest.to(tl.int32) + 2 * VOTING.bins) % VOTING.bins
    return tl.minimum(tl.maximum(bins, 0), VOTING.bins - 1), position - nearest  # clamped for NaN


@triton.jit
def bin_after(bins, VOTING: tl.constexpr):
    return tl.where(bins == VOTING.bins - 1, 0, bins + 1)


@triton.jit
def bin_before(bins, VOTING: tl.constexpr):
    return tl.where(bins == 0, VOTING.bins - 1, bins - 1)


@triton.jit
def _beside(near, r, VOTING: tl.constexpr):
    """The bin at the other side of the position."""
    return tl.where(r < 0, bin_before(near, VOTING), bin_after(near, VOTING))


@triton.jit
def linear_votes(gx, gy, table, VOTING: tl.constexpr):
    """By the angle of Eq. 2."""
    v = -gy if VOTING.counterclockwise else gy
    near, r = _near(_half_turns(gx, v) * VOTING.bins_per_half_turn - VOTING.offset, VOTING)
    return near, _beside(near, r, VOTING), tl.abs(r), near, r


@triton.jit
def opencv_votes(gx, gy, table, VOTING: tl.constexpr):
    """By OpenCV's arctangent, in float32: :func:`nablahog.hog.library_angles.opencv`."""
    p1, p3, p5, p7 = VOTING.opencv[0], VOTING.opencv[1], VOTING.opencv[2], VOTING.opencv[3]
    u, v = gx.to(tl.float32), gy.to(tl.float32)
    au, av = tl.abs(u), tl.abs(v)
    t = tl.div_rn(tl.minimum(au, av), tl.maximum(au, av) + VOTING.opencv[4])
    s = t * t
    angle = (((p7 * s + p5) * s + p3) * s + p1) * t
    angle = tl.where(av > au, 90 - angle, angle)
    angle = tl.where(u < 0, 180 - angle, angle)
    angle = tl.where(v < 0, 360 - angle, angle)
    position = angle * VOTING.opencv[5] * VOTING.opencv[6] - VOTING.offset
    near, r = _near(position.to(gx.dtype), VOTING)
    return near, _beside(near, r, VOTING), tl.abs(r), near, r


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
def vlfeat_votes(gx, gy, table, VOTING: tl.constexpr):
    """By VLFeat's arccosine, in float32: :func:`nablahog.hog.library_angles.vlfeat`."""
    axes: tl.constexpr = VOTING.axes
    u, v = gx.to(tl.float32), gy.to(tl.float32)
    length = root(u * u + v * v)
    zero = tl.zeros_like(u)
    largest, second = zero - 1, zero - 1
    own, other = zero.to(tl.int32), zero.to(tl.int32)
    for k in range(axes):  # the first of equals
        dot = u * tl.load(table + k).to(tl.float32) + v * tl.load(table + axes + k).to(tl.float32)
        size = tl.abs(dot)
        bins = tl.where((dot < 0) & VOTING.signed, k + axes, k)
        better, next_ = size > largest, size > second
        other = tl.where(better, own, tl.where(next_, bins, other))
        second = tl.where(better, largest, tl.where(next_, size, second))
        own, largest = tl.where(better, bins, own), tl.where(better, size, largest)
    some = length > 0
    cosine = tl.where(some, tl.div_rn(largest, tl.where(some, length, 1.0)), 1.0)
    f = tl.div_rn(_arccosine(tl.minimum(cosine, 1.0)), zero + VOTING.between_axes)
    _, _, _, near, r = linear_votes(gx, gy, table, VOTING)
    return own, other, f.to(gx.dtype), near, r


@triton.jit
def nearest_votes(gx, gy, table, VOTING: tl.constexpr):
    """Hard votes for the largest |dot product| with the bin directions, the first on ties."""
    axes: tl.constexpr = VOTING.axes
    zero = tl.zeros_like(gx)
    largest, own = zero - 1, zero.to(tl.int32)
    for k in range(axes):
        dot = gx * tl.load(table + k) + gy * tl.load(table + axes + k)
        better = tl.abs(dot) > largest
        bins = tl.where((dot < 0) & VOTING.signed, k + axes, k)
        own, largest = tl.where(better, bins, own), tl.where(better, tl.abs(dot), largest)
    return own, own, zero, own, zero


@triton.jit
def begun_votes(gx, gy, table, VOTING: tl.constexpr):
    """Hard votes for the bin in whose interval [begin, end) the angle is, by cross products."""
    bins: tl.constexpr = VOTING.bins
    u, v = gx, -gy if VOTING.counterclockwise else gy
    lower = (v < 0) | ((v == 0) & (u < 0))  # of the half-plane of angles in [π, 2π)
    if not VOTING.signed:
        u, v = tl.where(lower, -u, u), tl.where(lower, -v, v)
        lower = lower & (v != v)
    begun = tl.zeros_like(gx).to(tl.int32)
    for k in range(bins):
        ahead = v * tl.load(table + k) - u * tl.load(table + bins + k) >= 0
        early = tl.load(table + 2 * bins + k) > 0
        begun += tl.where(early, ahead | lower, ahead & lower).to(tl.int32)
    own = (begun + VOTING.before) % bins
    zero = tl.zeros_like(gx)
    return own, own, zero, own, zero
