"""Eq. 2-4 compiled, a line of pixels at a time: what each pixel votes.

With m its magnitude, a pixel gives (1 - f) · m to one bin and f · m to the next; a hard vote has no f.  Pixels whose
squared magnitude is below ``tiny`` have none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...runtime.compile import compiled, inlined
from .orientation_simd import begun_signed_votes, begun_votes, linear_votes, nearest_votes, opencv_votes, vlfeat_votes
from .parameters import LINEAR, NEAREST, OPENCV, VLFEAT

# atan(t) / π for t in 0…1, within 8e-8: an odd polynomial, so that right angles stay exactly on their bin centres
ARCTANGENT = np.array(
    [0.3183086485, -0.1060524763, 0.06305023492, -0.04212303499, 0.02534499976, -0.01069655349, 0.002168260411],
    np.float32,
)


@inlined
def magnitudes(gx: Any, gy: Any, tiny: Any, m: Any) -> None:
    """‖∇‖ of Eq. 2."""
    zero = m.dtype.type(0)
    for x in range(m.size):
        squared = gx[x] * gx[x] + gy[x] * gy[x]
        m[x] = zero if squared < tiny else math.sqrt(squared)


@inlined
def _whole(position: Any, count: Any, zero: Any) -> Any:
    """The bin at or before a position of at most two turns, as a whole number in 0 … count - 1."""
    bin_ = np.floor(position)
    bin_ = bin_ + count if bin_ < zero else bin_
    bin_ = bin_ + count if bin_ < zero else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    bin_ = bin_ - count if bin_ >= count else bin_
    return bin_ if bin_ >= zero else zero  # of NaN


@inlined
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
def linear(gx: Any, gy: Any, voting: Any, m: Any, f: Any, bins: Any) -> None:
    """Linear votes by the exact angle."""
    if gx.itemsize == 4:
        linear_votes(gx, gy, voting.numbers, ARCTANGENT, m, f, bins)
    else:
        magnitudes(gx, gy, voting.tiny, m)
        args = voting.tiny, voting.up, voting.per_half_turn, voting.offset, voting.count
        linear_double(gx, gy, *args, f, bins)


@compiled
def vote_line(gx: Any, gy: Any, voting: Any, m: Any, f: Any, bins: Any) -> None:
    """Votes of planes of gradients by ``voting``, a :class:`.parameters.Voting`."""
    if voting.kind == LINEAR:
        linear(gx, gy, voting, m, f, bins)
    elif voting.kind == OPENCV:
        opencv_votes(gx, gy, voting.numbers, voting.opencv, m, f, bins)
    elif voting.kind == VLFEAT:
        axes = voting.vlfeat.size // 2
        of_bins = axes, axes if voting.signed else 0, voting.bins
        vlfeat_votes(gx, gy, voting.numbers, voting.vlfeat, voting.arccosine, *of_bins, m, f, bins)
    elif voting.kind == NEAREST:
        axes = voting.directions.size // 2
        nearest_votes(gx, gy, voting.numbers, voting.directions, axes, axes if voting.signed else 0, m, bins)
    else:
        count = voting.starts.size // 3
        if voting.signed:
            begun_signed_votes(gx, gy, voting.numbers, voting.starts, count, voting.before, m, bins)
        else:
            begun_votes(gx, gy, voting.numbers, voting.starts, count, voting.before, m, bins)
