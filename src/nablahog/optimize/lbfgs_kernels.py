"""Compiled loops over the vectors of :class:`.lbfgs.LbfgsVectors`: those of a problem stay in caches."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, NamedTuple

from ..runtime.arrays import Floats, Integers, Real
from ..runtime.compile import compiled, inlined
from ..runtime.lanes import Array, Builder, Variable
from ..runtime.simd import lanes, vector_function, vector_instruction
from .lbfgs_decisions import ALONG, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW

if TYPE_CHECKING:
    from llvmlite import ir

PIECE = 1024  # numbers that stay in the fastest memory while all stored vectors are read or added to them
FOURS = 64  # numbers: four vectors, or eight, or sixteen


class _Pair(NamedTuple):
    """Where two stored vectors begin: a step, and the change of the gradient."""

    s: int
    y: int


def _fours(write: Builder, x: Array, count: ir.Value) -> AbstractContextManager[ir.Value]:
    """A loop over ``count`` numbers, a multiple of :data:`FOURS`, four vectors at a time."""
    return write.loop(count, 4 * lanes(x.itemsize))


@vector_function
def _products(write: Builder, left: Array, at: ir.Value, right: Array, begin: ir.Value, count: ir.Value) -> ir.Value:
    """The dot product of ``left[at:]`` and ``right[begin:]``, ``count`` numbers, a multiple of :data:`FOURS`."""
    width = lanes(left.itemsize)
    sums = [Variable(write.constant(left.vector(width), 0.0)) for _ in range(4)]  # independent
    with _fours(write, left, count) as k:
        for j, each in enumerate(sums):
            one = left.load(write.add(at, k, j * width), width)
            other = right.load(write.add(begin, k, j * width), width)
            each.set(one.multiply_add(other, each.get()))
    first, second, third, fourth = (each.get() for each in sums)
    return ((first + second) + (third + fourth)).sum()


@vector_instruction
def _changes(
    write: Builder,
    new: Array,
    old: Array,
    direction: Array,
    begin: ir.Value,
    count: ir.Value,
    out: Array,
    at: ir.Value,
) -> None:
    """To ``out[at:]``, the dot products other than those with stored vectors, of numbers from ``begin`` on."""
    width = lanes(new.itemsize)
    sums = [Variable(write.constant(new.vector(width), 0.0)) for _ in range(BESIDE)]
    with _fours(write, new, count) as k:
        for j in range(4):
            here = write.add(begin, k, j * width)
            gradient, before, along = (each.load(here, width) for each in (new, old, direction))
            change = gradient - before
            pairs = {
                ALONG: (gradient, along),
                CHANGE_ALONG: (change, along),
                CHANGE_SQUARED: (change, change),
                CHANGE_WITH_NEW: (change, gradient),
            }
            for which, (left, right) in pairs.items():
                sums[which].set(left.multiply_add(right, sums[which].get()))
    for which, each in enumerate(sums):
        out.store_scalar(write.add(at, which), each.get().sum())


@vector_instruction
def _store_pair(
    write: Builder,
    new: Array,
    old: Array,
    along: Array,
    begin: ir.Value,
    step: ir.Value,
    stored: Array,
    pair: _Pair,
    count: ir.Value,
) -> None:
    """Stores a step along a direction as ``pair.s``, and the gradient's change as ``pair.y``."""
    width = lanes(new.itemsize)
    length = write.splat(step, width)
    with _fours(write, new, count) as k:
        for j in range(4):
            x = write.add(k, j * width)
            gradient, before, direction = (each.load(write.add(begin, x), width) for each in (new, old, along))
            stored.store(write.add(pair.s, x), length * direction)
            stored.store(write.add(pair.y, x), gradient - before)


@vector_function
def _step(
    write: Builder,
    xs: Array,
    along: Array,
    begin: ir.Value,
    step: ir.Value,
    new: Array,
    gradients: Array,
    by: ir.Value,
    count: ir.Value,
) -> ir.Value:
    """A step along a direction, and the new gradient, ``by`` times which the next direction begins with.

    Returns the largest absolute number of the gradient.
    """
    width = lanes(xs.itemsize)
    largest = Variable(write.constant(xs.vector(width), 0.0))
    length, factor = write.splat(step, width), write.splat(by, width)
    with _fours(write, xs, count) as k:
        for j in range(4):
            here = write.add(begin, k, j * width)
            x, direction, gradient = (each.load(here, width) for each in (xs, along, new))
            xs.store(here, x + length * direction)
            gradients.store(here, gradient)
            along.store(here, factor * gradient)
            size = gradient.abs()
            largest.set(size.compare(">", largest.get()).where(size, largest.get()))
    return largest.get().max()


@vector_instruction
def _add_pair(
    write: Builder,
    to: Array,
    begin: ir.Value,
    stored: Array,
    pair: _Pair,
    by_s: ir.Value,
    by_y: ir.Value,
    count: ir.Value,
) -> None:
    """Adds two stored vectors, each times a number, to ``count`` numbers from ``begin`` on."""
    width = lanes(to.itemsize)
    first, second = write.splat(by_s, width), write.splat(by_y, width)
    with _fours(write, to, count) as k:
        for j in range(4):
            here, x = write.add(begin, k, j * width), write.add(k, j * width)
            total = first.multiply_add(stored.load(write.add(pair.s, x), width), to.load(here, width))
            to.store(here, second.multiply_add(stored.load(write.add(pair.y, x), width), total))


@inlined
def _dot(left: Floats, at: int, right: Floats, begin: int, count: int) -> Real:
    whole = count // FOURS * FOURS
    total: Real = _products(left, at, right, begin, whole)
    for k in range(whole, count):
        total += left[at + k] * right[begin + k]
    return total


@compiled
def dots(
    start: int, stop: int, n: int, new: Floats, old: Floats, directions: Floats, stored: Floats, out: Floats
) -> None:
    """Dot products of rows start … stop - 1, to ``out``.  Vectors of length n lie one after the other."""
    both = out.shape[1] - BESIDE
    whole = n // FOURS * FOURS
    flat = out.reshape(-1)
    for i in range(start, stop):
        begin, at = i * n, i * out.shape[1] + both
        _changes(new, old, directions, begin, whole, flat, at)
        for k in range(begin + whole, begin + n):
            change = new[k] - old[k]
            flat[at + ALONG] += new[k] * directions[k]
            flat[at + CHANGE_ALONG] += change * directions[k]
            flat[at + CHANGE_SQUARED] += change * change
            flat[at + CHANGE_WITH_NEW] += change * new[k]
        out[i, :both] = 0
        for piece in range(0, n, PIECE):
            count = min(PIECE, n - piece)
            for k in range(both):
                out[i, k] += _dot(stored, (i * both + k) * n + piece, new, begin + piece, count)


@inlined
def _combine(
    begin: int, count: int, first: int, n: int, coefficients: Floats, stored: Floats, directions: Floats
) -> None:
    """directions[begin:] += Σ_k coefficient_k · stored vector k, ``count`` numbers; vector 0's are at ``first``."""
    m, whole = len(coefficients) // 2, count // FOURS * FOURS
    for k in range(m):
        s, y, by_s, by_y = first + k * n, first + (k + m) * n, coefficients[k], coefficients[k + m]
        _add_pair(directions, begin, stored, _Pair(s, y), by_s, by_y, whole)
        for x in range(whole, count):
            directions[begin + x] += by_s * stored[s + x] + by_y * stored[y + x]


@compiled
def take_step(
    start: int,
    stop: int,
    taken: Floats,
    places: Integers,
    coefficients: Floats,
    new: Floats,
    xs: Floats,
    gradients: Floats,
    directions: Floats,
    stored: Floats,
    slopes: Floats,
    peaks: Floats,
) -> None:
    """Rows start … stop - 1 of :meth:`.LbfgsVectors.take_step`.  The vectors lie one after the other."""
    both, n = coefficients.shape[1] - 1, len(xs) // len(taken)
    for i in range(start, stop):
        step, by = taken[i], coefficients[i, both]
        if step > 0:
            slope, peak = step - step, step - step
            for piece in range(0, n, PIECE):
                begin, count, first = i * n + piece, min(PIECE, n - piece), i * both * n + piece
                whole = count // FOURS * FOURS
                if places[i] >= 0:
                    s, y = first + places[i] * n, first + (places[i] + both // 2) * n
                    _store_pair(new, gradients, directions, begin, step, stored, _Pair(s, y), whole)
                    for x in range(whole, count):
                        stored[s + x] = step * directions[begin + x]
                        stored[y + x] = new[begin + x] - gradients[begin + x]
                peak = max(peak, _step(xs, directions, begin, step, new, gradients, by, whole))
                for x in range(begin + whole, begin + count):
                    xs[x] += step * directions[x]
                    gradients[x], directions[x] = new[x], by * new[x]
                    peak = max(peak, abs(new[x]))
                _combine(begin, count, first, n, coefficients[i, :both], stored, directions)
                slope += _dot(gradients, begin, directions, begin, count)
            slopes[i], peaks[i] = slope, peak
