"""Eq. 2-4 compiled: gradients to votes.

A pixel of magnitude m gives (1 - f) · m to one bin and f · m to the next; a hard vote has no f.  Pixels whose squared
magnitude is below ``tiny`` give nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Integers, Real
from ...runtime.compile import borrowing, inlined
from ...runtime.simd import aligned_zeros
from .orientation_simd import begun_signed_votes, begun_votes, nearest_votes, single_votes, vlfeat_votes
from .parameters import LINEAR, NEAREST, OPENCV, VLFEAT, Voting

# atan(t) / π for t in 0…1, within 8e-8: an odd polynomial, so that right angles stay exactly on their bin centres
ARCTANGENT = np.array(
    [0.3183086485, -0.1060524763, 0.06305023492, -0.04212303499, 0.02534499976, -0.01069655349, 0.002168260411],
    np.float32,
)


class Votes(NamedTuple):
    """Planes."""

    m: Floats
    f: Floats
    bins: Integers  # int32


def new_votes(size: int, dtype: DType) -> Votes:
    return Votes(aligned_zeros(size, dtype), aligned_zeros(size, dtype), aligned_zeros(size, np.int32))


@inlined
def _magnitudes(gx: Floats, gy: Floats, tiny: Real, m: Floats) -> None:
    """‖∇‖ of Eq. 2."""
    zero = m.dtype.type(0)
    for k in range(m.size):
        x = np.uintp(k)
        squared = gx[x] * gx[x] + gy[x] * gy[x]
        m[x] = zero if squared < tiny else math.sqrt(squared)


@inlined
def _wrapped(position: Real, count: Real, per_bin: Real) -> tuple[Real, np.int32]:
    """The distance of a position from the bin at or before it, and that bin; 0 for NaN."""
    zero, half = np.float32(0), np.float32(0.5)  # a plain 0 would turn all of it to float64
    before = np.floor(position)
    bin_ = before - np.floor((before + half) * per_bin) * count
    return position - before, np.int32(bin_ if bin_ > zero else zero)


@inlined
def _whole(position: Real, count: Real) -> Real | float:
    """The bin at or before a position of at most two turns, as a whole number in 0 … count - 1."""
    bin_ = np.floor(position)
    bin_ = bin_ + count if bin_ < 0.0 else bin_
    bin_ = bin_ + count if bin_ < 0.0 else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    return bin_ if bin_ >= 0.0 else 0.0  # of NaN


@inlined
def _linear_double(gx: Floats, gy: Floats, voting: Voting, f: Floats, bins: Integers) -> None:
    """Linear votes in float64."""
    for x in range(f.size):
        u, v = gx[x], voting.up * gy[x]
        turn = 0.0 if u * u + v * v < voting.tiny else math.atan2(v, u) / math.pi
        position = turn * voting.bins_per_half_turn - voting.offset
        f[x] = position - np.floor(position)
        bins[x] = np.int32(_whole(position, voting.turn))


@borrowing
def linear_votes(gx: Floats, gy: Floats, voting: Voting, m: Floats, f: Floats, bins: Integers) -> None:
    """Linear votes by the exact angle."""
    if gx.itemsize == 4:
        turns = voting.bins_per_half_turn, voting.offset, voting.turn, voting.per_bin
        single_votes(gx, gy, voting.tiny, voting.up, ARCTANGENT, *turns, m, f, bins)
    else:
        _magnitudes(gx, gy, voting.tiny, m)
        _linear_double(gx, gy, voting, f, bins)


@inlined
def _opencv_votes(gx: Floats, gy: Floats, voting: Voting, f: Floats, bins: Integers) -> None:
    """Linear votes by OpenCV's arctangent, in float32: :func:`nablahog.hog.library_angles.opencv`.

    Numba vectorises this loop: vector instructions gained 1.02 in a call of `hog` (`opencv`), and were removed.
    """
    p1, p3, p5, p7 = voting.opencv[0], voting.opencv[1], voting.opencv[2], voting.opencv[3]
    guard, radian, per_radian = voting.opencv[4], voting.opencv[5], voting.opencv[6]
    offset, count, per_bin = np.float32(voting.offset), np.float32(voting.turn), np.float32(voting.per_bin)
    right, straight, full, zero = np.float32(90), np.float32(180), np.float32(360), np.float32(0)
    for k in range(f.size):
        x = np.uintp(k)
        u, v = np.float32(gx[x]), np.float32(gy[x])
        au, av = abs(u), abs(v)
        steep = au < av
        small, large = (au, av) if steep else (av, au)
        t = small / (large + guard)
        s = t * t
        angle = (((p7 * s + p5) * s + p3) * s + p1) * t
        angle = right - angle if steep else angle
        angle = straight - angle if u < zero else angle
        angle = full - angle if v < zero else angle
        f[x], bins[x] = _wrapped(angle * radian * per_radian - offset, count, per_bin)


@borrowing
def vote(gx: Floats, gy: Floats, voting: Voting, m: Floats, f: Floats, bins: Integers) -> None:
    """Votes of planes of gradients; a hard vote writes no ``f``."""
    if voting.kind == LINEAR:
        linear_votes(gx, gy, voting, m, f, bins)
    elif voting.kind == OPENCV:
        _magnitudes(gx, gy, voting.tiny, m)
        _opencv_votes(gx, gy, voting, f, bins)
    elif voting.kind == VLFEAT:
        axes = voting.vlfeat.size // 2
        opposite = axes if voting.signed else 0
        search = voting.tiny, voting.vlfeat, voting.arccosine, axes, opposite, voting.bins
        vlfeat_votes(gx, gy, *search, m, f, bins)
    elif voting.kind == NEAREST:
        axes = voting.directions.size // 2
        nearest_votes(gx, gy, voting.tiny, voting.directions, axes, axes if voting.signed else 0, m, bins)
    else:
        starts = voting.starts, voting.starts.size // 3, voting.before
        if voting.signed:
            begun_signed_votes(gx, gy, voting.tiny, voting.up, *starts, m, bins)
        else:
            begun_votes(gx, gy, voting.tiny, voting.up, *starts, m, bins)
