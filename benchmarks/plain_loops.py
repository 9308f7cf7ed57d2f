"""Plain Numba loops that do what the kernels' vector routines do, to be put in their place: see vector_routines.py."""

from __future__ import annotations

import math

import numpy as np

from nablahog.hog.kernels.gradient_loops import padded
from nablahog.hog.kernels.norm_simd import Corners
from nablahog.hog.kernels.orientation_simd import LEAST
from nablahog.hog.kernels.parameters import Pooling
from nablahog.hog.kernels.pooling_vjp import CellGradients, VoteGradients
from nablahog.hog.kernels.votes import Votes
from nablahog.runtime.arrays import Floats, Integers, Real
from nablahog.runtime.compile import compiled, inlined


@inlined
def _magnitude(u: Real, v: Real, tiny: Real) -> Real | float:
    squared = u * u + v * v
    return squared - squared if squared < tiny else math.sqrt(squared)


@inlined
def nearest_votes(
    gx: Floats, gy: Floats, tiny: Real, directions: Floats, axes: int, opposite: int, m: Floats, bins: Integers
) -> None:
    for k in range(m.size):
        x = np.uintp(k)
        m[x] = _magnitude(gx[x], gy[x], tiny)
        largest, bin_ = -abs(gx[x]) - 1, 0
        for axis in range(axes):
            dot = gx[x] * directions[axis] + gy[x] * directions[axis + axes]
            if abs(dot) > largest:
                largest, bin_ = abs(dot), axis + (opposite if dot < 0 else 0)
        bins[x] = bin_


@inlined
def _begun(
    gx: Floats,
    gy: Floats,
    tiny: Real,
    up: Real,
    starts: Floats,
    count: int,
    before: int,
    m: Floats,
    bins: Integers,
    signed: bool,
) -> None:
    for k in range(m.size):
        x = np.uintp(k)
        m[x] = _magnitude(gx[x], gy[x], tiny)
        u, v = gx[x], up * gy[x]
        back = v < 0 or (v == 0 and u < 0)
        us, vs = (-u, -v) if back else (u, v)
        bin_ = before
        for j in range(count):
            across = vs * starts[j] - us * starts[j + count]
            begun = across >= 0
            if signed:
                begun = across <= 0 if back else begun
                begun = begun or back if starts[j + 2 * count] > 0 else begun and back
            bin_ += 1 if begun else 0
        bin_ = bin_ - count if bin_ >= count else bin_
        bins[x] = bin_ - count if bin_ >= count else bin_


@inlined
def begun_votes(
    gx: Floats,
    gy: Floats,
    tiny: Real,
    up: Real,
    starts: Floats,
    count: int,
    before: int,
    m: Floats,
    bins: Integers,
) -> None:
    _begun(gx, gy, tiny, up, starts, count, before, m, bins, False)


@inlined
def begun_signed_votes(
    gx: Floats,
    gy: Floats,
    tiny: Real,
    up: Real,
    starts: Floats,
    count: int,
    before: int,
    m: Floats,
    bins: Integers,
) -> None:
    _begun(gx, gy, tiny, up, starts, count, before, m, bins, True)


@inlined
def vlfeat_votes(
    gx: Floats,
    gy: Floats,
    tiny: Real,
    directions: Floats,
    arccosine: Floats,
    axes: int,
    opposite: int,
    count: int,
    m: Floats,
    f: Floats,
    bins: Integers,
) -> None:
    least, unit = arccosine[0], arccosine[1]
    for k in range(m.size):
        x = np.uintp(k)
        m[x] = _magnitude(gx[x], gy[x], tiny)
        u, v = np.float32(gx[x]), np.float32(gy[x])
        most, following, best, second = np.float32(-1), np.float32(-1), 0, 0
        for axis in range(axes):
            dot = u * directions[axis] + v * directions[axis + axes]
            size, bin_ = abs(dot), axis + (opposite if dot < 0 else 0)
            if size > most:
                most, following, best, second = size, most, bin_, best
            elif size > following:
                following, second = size, bin_
        length = np.float64(math.sqrt(u * u + v * v))
        cosine = np.float64(most) / (length if length > least else least)
        cosine = np.float64(np.float32(cosine if cosine < 1 else 1.0))
        share = np.float32(math.acos(cosine) / unit)
        ahead = second == (0 if best + 1 == count else best + 1)
        f[x] = share if ahead else np.float32(1) - share
        bins[x] = best if ahead else second


@compiled
def pool(sums: Floats, part: int, pooling: Pooling, band_cells: Floats) -> None:
    size, wide, length, step = padded(pooling.columns), pooling.wide, pooling.length, pooling.column_size
    first, last = pooling.parts[part]
    begin = pooling.runs[first, 0]
    for run in range(first, last):
        start, stop, cell = pooling.runs[run]
        for k in range(pooling.high * pooling.bins):
            for beside in range(wide):
                weight, at = (run * wide + beside) * length, k * size - begin
                total = band_cells[(cell + beside) * step + k]
                for x in range(start, stop):
                    total += sums[at + x] * pooling.by_col[weight + x - start]
                band_cells[(cell + beside) * step + k] = total


@compiled
def sum_up(
    votes: Votes, stride: int, first: int, rows: int, hard: bool, pooling: Pooling, sums: Floats, band_cells: Floats
) -> None:
    """Scatter: each pixel adds its votes to all cells that it votes into."""
    high, wide, count, step = pooling.high, pooling.wide, pooling.bins, pooling.column_size
    band_cells[:] = 0
    for row in range(rows):
        for run in range(pooling.runs.shape[0]):
            start, stop, cell = pooling.runs[run]
            for x in range(start, stop):
                at = row * stride + x
                bin_ = votes.bins[at]
                next_ = bin_ + 1 if bin_ + 1 < count else 0
                far = votes.m[at] - votes.m[at] if hard else votes.m[at] * votes.f[at]
                near = votes.m[at] - far
                for beside in range(wide):
                    column = pooling.by_col[(run * wide + beside) * pooling.length + x - start]
                    for below in range(high):
                        weight = column * pooling.by_row[(first + row) * high + below]
                        to = (cell + beside) * step + below * count
                        band_cells[to + bin_] += weight * near
                        if not hard:
                            band_cells[to + next_] += weight * far


@inlined
def votes_gradient(
    gradients: CellGradients, bins: Integers, stride: int, first: int, rows: int, pooling: Pooling, out: VoteGradients
) -> None:
    """Gather: each pixel reads three bins of all cells that it votes into."""
    high, wide, line = pooling.high, pooling.wide, gradients.cells.shape[2]
    source, row_size, zero = gradients.cells.reshape(-1), gradients.cells.shape[1] * line, out.here.dtype.type(0)
    for row in range(rows):
        for run in range(pooling.runs.shape[0]):
            start, stop, cell = pooling.runs[run]
            for x in range(start, stop):
                at = row * stride + x
                a, b, c = zero, zero, zero
                for beside in range(wide):
                    column = pooling.by_col[(run * wide + beside) * pooling.length + x - start]
                    for below in range(high):
                        weight = column * pooling.by_row[(first + row) * high + below]
                        k = below * row_size + (cell + beside) * line + bins[at]
                        a += weight * source[k]
                        b += weight * source[k + 1]
                        c += weight * source[k + 2]
                out.before[at], out.here[at], out.after[at] = a, b, c


@inlined
def _arctangent(u: Real, v: Real, coefficients: Floats) -> Real | float:
    """The angle of (u, v) in half turns."""
    zero, half, one, least = np.float32(0), np.float32(0.5), np.float32(1), np.float32(LEAST)
    au, av = abs(u), abs(v)
    steep = au < av
    small, large = (au, av) if steep else (av, au)
    t = small / (least if large < least else large)
    s = t * t
    turn = coefficients[6]
    for j in range(5, -1, -1):
        turn = turn * s + coefficients[j]
    turn = t * turn
    turn = np.float32(0.25) if small == large else turn
    turn = half - turn if steep else turn
    turn = one - turn if u < zero else turn
    return math.copysign(turn, v)


@inlined
def single_votes(
    gx: Floats,
    gy: Floats,
    tiny: Real,
    up: Real,
    arctangent: Floats,
    bins_per_half_turn: Real,
    offset: Real,
    turn: Real,
    per_bin: Real,
    m: Floats,
    f: Floats,
    bins: Integers,
) -> None:
    zero, half = np.float32(0), np.float32(0.5)
    for k in range(m.size):
        x = np.uintp(k)
        m[x] = _magnitude(gx[x], gy[x], tiny)
        position = _arctangent(gx[x], up * gy[x], arctangent) * bins_per_half_turn - offset
        before = np.floor(position)
        bin_ = before - np.floor((before + half) * per_bin) * turn
        f[x], bins[x] = position - before, np.int32(bin_ if bin_ > zero else zero)


@inlined
def copy(source: Floats, begin: int, count: int, out: Floats, to: int) -> None:
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] = source[np.uintp(begin) + np.uintp(k)]


@inlined
def copy_scaled(source: Floats, begin: int, count: int, out: Floats, to: int, factor: Real) -> None:
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] = factor * source[np.uintp(begin) + np.uintp(k)]


@inlined
def add(source: Floats, begin: int, count: int, out: Floats, to: int) -> None:
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] += source[np.uintp(begin) + np.uintp(k)]


@inlined
def add_scaled(source: Floats, begin: int, count: int, out: Floats, to: int, factor: Real) -> None:
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] += factor * source[np.uintp(begin) + np.uintp(k)]


@inlined
def read_line(source: Floats, begin: int, step: int, count: int, out: Floats, to: int) -> None:
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] = source[np.uintp(begin) + np.uintp(k)]


@inlined
def read_folded(source: Floats, begin: int, step: int, count: int, out: Floats, to: int) -> None:
    first, second = np.uintp(begin), np.uintp(begin + step)
    for k in range(count):
        out[np.uintp(to) + np.uintp(k)] = source[first + np.uintp(k)] + source[second + np.uintp(k)]


@inlined
def dot(left: Floats, at: int, right: Floats, begin: int, count: int) -> Real:
    zero = left.dtype.type(0)
    a, b, c, d = zero, zero, zero, zero
    one, two, three = np.uintp(1), np.uintp(2), np.uintp(3)
    whole = count // 4 * 4
    for k in range(0, whole, 4):  # four sums, which do not wait for each other
        x, y = np.uintp(at) + np.uintp(k), np.uintp(begin) + np.uintp(k)
        a += left[x] * right[y]
        b += left[x + one] * right[y + one]
        c += left[x + two] * right[y + two]
        d += left[x + three] * right[y + three]
    total: Real = (a + b) + (c + d)
    for k in range(whole, count):
        total += left[np.uintp(at) + np.uintp(k)] * right[np.uintp(begin) + np.uintp(k)]
    return total


@inlined
def _clip(value: Real, clip: Real) -> Real:
    return clip if value > clip else value


@inlined
def _through_clip(entry: Real, clip: Real, grad: Real) -> Real:
    passed = grad * np.float32(0.5) if entry == clip else grad
    return passed - passed if entry > clip else passed


@inlined
def clipped(x: Floats, factor: Real, clip: Real, out: Floats, to: int) -> None:
    for k in range(x.size):
        out[np.uintp(to) + np.uintp(k)] = _clip(x[k] * factor, clip)


@inlined
def clipped_norm_vjp(
    x: Floats, grad: Floats, factor: Real, clip: Real, by_grad: Real, by_clipped: Real, out: Floats, to: int
) -> None:
    for k in range(x.size):
        entry = x[k] * factor
        through = grad[k] * by_grad - _clip(entry, clip) * by_clipped
        out[np.uintp(to) + np.uintp(k)] = _through_clip(entry, clip, through)


@inlined
def norm_vjp(x: Floats, grad: Floats, by_grad: Real, by_x: Real, less: Real, out: Floats, to: int) -> None:
    for k in range(x.size):
        out[np.uintp(to) + np.uintp(k)] = grad[k] * by_grad - (x[k] * by_x + less)


@inlined
def half_sums(x: Floats, factors: Corners, clip: Real, out: Floats, to: int) -> None:
    half = out.dtype.type(0.5)
    f, g, h, i = factors
    for k in range(x.size):
        upper = _clip(x[k] * f, clip) + _clip(x[k] * g, clip)
        lower = _clip(x[k] * h, clip) + _clip(x[k] * i, clip)
        out[np.uintp(to) + np.uintp(k)] = (upper + lower) * half


@inlined
def clipped_totals(x: Floats, factors: Corners, clip: Real, out: Floats) -> None:
    a, b, c, d = out[0], out[1], out[2], out[3]
    f, g, h, i = factors
    for k in range(x.size):
        a += _clip(x[k] * f, clip)
        b += _clip(x[k] * g, clip)
        c += _clip(x[k] * h, clip)
        d += _clip(x[k] * i, clip)
    out[0], out[1], out[2], out[3] = a, b, c, d


@inlined
def clipped_vjp(
    x: Floats,
    factors: Corners,
    clip: Real,
    grad: Floats,
    stride: int,
    by_grad: Real,
    grad_totals: Corners,
    grad_factors: Floats,
    out: Floats,
) -> None:
    a, b, c, d = grad_factors[0], grad_factors[1], grad_factors[2], grad_factors[3]
    f, g, h, i = factors
    t, u, v, w = grad_totals
    for k in range(x.size):
        p = _through_clip(x[k] * f, clip, grad[np.uintp(k)] * by_grad + t)
        q = _through_clip(x[k] * g, clip, grad[np.uintp(stride) + np.uintp(k)] * by_grad + u)
        r = _through_clip(x[k] * h, clip, grad[np.uintp(2 * stride) + np.uintp(k)] * by_grad + v)
        s = _through_clip(x[k] * i, clip, grad[np.uintp(3 * stride) + np.uintp(k)] * by_grad + w)
        out[k] = (p * f + q * g) + (r * h + s * i)
        a, b, c, d = a + p * x[k], b + q * x[k], c + r * x[k], d + s * x[k]
    grad_factors[0], grad_factors[1], grad_factors[2], grad_factors[3] = a, b, c, d


def fits(size: int, bins: int) -> bool:
    """No table look-up."""
    return False
