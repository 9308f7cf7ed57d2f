"""The long vectors of a batch of searches, in loops for a CPU: see :class:`.lbfgs_vectors.Vectors`."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ..runtime.compile import compiled, inlined, instruction
from ..runtime.simd import Builder, Lanes, lanes
from ..runtime.threads import share_out
from .lbfgs_decisions import ALONG, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW
from .lbfgs_vectors import Vectors

PIECE = 1024  # numbers that stay in the fastest memory while all stored vectors are read or added to them
FOURS = 64  # numbers: four vectors, or eight, or sixteen


def _fours(write: Builder, count: Any) -> Any:
    """Over ``count`` numbers, a multiple of :data:`FOURS`, four vectors at a time."""
    from numba.core import cgutils

    return cgutils.for_range_slice(write.builder, write.whole(0), count, write.whole(4 * lanes(write.size(0))))


@instruction
def _products(_: Any, left: Any, at: Any, right: Any, begin: Any, count: Any) -> Any:
    """The sum of products of ``count`` numbers, a multiple of :data:`FOURS`, from two places on."""

    def build(*call: Any) -> Any:
        write = Builder(*call)
        builder, width = write.builder, lanes(write.size(0))
        type_ = write.vector(write.number(0), width)
        sums = [write.variable(type_) for _ in range(4)]  # which do not wait for each other
        for each in sums:
            builder.store(write.zeros(type_), each)
        _, at, _, begin, count = write.arguments
        with _fours(write, count) as (k, _):
            for j, each in enumerate(sums):
                one = write.load(0, write.add(at, k, j * width), width)
                other = write.load(2, write.add(begin, k, j * width), width)
                builder.store(write.product_sum(one, other, builder.load(each)), each)
        first, second, third, fourth = (builder.load(each) for each in sums)
        return write.total(builder.fadd(builder.fadd(first, second), builder.fadd(third, fourth)))

    return left.dtype(left, at, right, begin, count), build


@instruction
def _changes(_: Any, new: Any, old: Any, direction: Any, begin: Any, count: Any, found: Any, at: Any) -> Any:
    """To ``found[at:]``, the sums of products beside those with stored vectors, of ``count`` numbers, likewise."""
    from numba.core import types

    def build(*call: Any) -> Any:
        write = Builder(*call)
        builder, width = write.builder, lanes(write.size(0))
        type_ = write.vector(write.number(0), width)
        sums = [write.variable(type_) for _ in range(BESIDE)]
        for each in sums:
            builder.store(write.zeros(type_), each)
        begin, count, at = write.arguments[3], write.arguments[4], write.arguments[6]
        with _fours(write, count) as (k, _):
            for j in range(4):
                new, old, along = (
                    Lanes(write, write.load(which, write.add(begin, k, j * width), width)) for which in range(3)
                )
                change = new - old
                pairs = {
                    ALONG: (new, along),
                    CHANGE_ALONG: (change, along),
                    CHANGE_SQUARED: (change, change),
                    CHANGE_WITH_NEW: (change, new),
                }
                for which, (left, right) in pairs.items():
                    total = write.product_sum(left.value, right.value, builder.load(sums[which]))
                    builder.store(total, sums[which])
        for which, each in enumerate(sums):
            place = write.place(5, write.add(at, which), write.number(5))
            builder.store(write.total(builder.load(each)), place)
        return call[0].get_dummy_value()

    return types.void(new, old, direction, begin, count, found, at), build


@instruction
def _store_pair(
    _: Any, new: Any, old: Any, along: Any, begin: Any, step: Any, stored: Any, s: Any, y: Any, count: Any
) -> Any:
    """To ``stored[s:]`` a step along a direction, to ``stored[y:]`` the gradient's change, likewise."""
    from numba.core import types

    def build(*call: Any) -> Any:
        write = Builder(*call)
        width = lanes(write.size(0))
        begin, step, s, y, count = (write.arguments[which] for which in (3, 4, 6, 7, 8))
        step = Lanes(write, write.splat(step, width))
        with _fours(write, count) as (k, _):
            for j in range(4):
                x = write.add(k, j * width)
                new, old, along = (Lanes(write, write.load(which, write.add(begin, x), width)) for which in range(3))
                write.store(5, write.add(s, x), (step * along).value)
                write.store(5, write.add(y, x), (new - old).value)
        return call[0].get_dummy_value()

    return types.void(new, old, along, begin, step, stored, s, y, count), build


@instruction
def _step(_: Any, xs: Any, along: Any, begin: Any, step: Any, new: Any, gradients: Any, by: Any, count: Any) -> Any:
    """A step along a direction, and the new gradient, of which ``by`` times is where the next direction begins.

    Returns the largest absolute number of the gradient.
    """

    def build(*call: Any) -> Any:
        write = Builder(*call)
        builder, width = write.builder, lanes(write.size(0))
        type_ = write.vector(write.number(0), width)
        largest = write.variable(type_)
        builder.store(write.zeros(type_), largest)
        begin, count = write.arguments[2], write.arguments[7]
        step, by = (Lanes(write, write.splat(write.arguments[which], width)) for which in (3, 6))
        with _fours(write, count) as (k, _):
            for j in range(4):
                here = write.add(begin, k, j * width)
                x, along, new = (Lanes(write, write.load(which, here, width)) for which in (0, 1, 4))
                write.store(0, here, (x + step * along).value)
                write.store(5, here, new.value)
                write.store(1, here, (by * new).value)
                so_far = Lanes(write, builder.load(largest))
                builder.store(new.abs().compare(">", so_far).where(new.abs(), so_far).value, largest)
        return write.largest(builder.load(largest))

    return xs.dtype(xs, along, begin, step, new, gradients, by, count), build


@instruction
def _add_pair(
    _: Any, to: Any, begin: Any, stored: Any, first: Any, second: Any, by_first: Any, by_second: Any, count: Any
) -> Any:
    """Adds two of the stored vectors from two places on, each times a number, to ``count`` numbers, likewise."""
    from numba.core import types

    def build(*call: Any) -> Any:
        write = Builder(*call)
        width = lanes(write.size(0))
        _, begin, _, first, second, *factors, count = write.arguments
        by_first, by_second = (write.splat(factor, width) for factor in factors)
        with _fours(write, count) as (k, _):
            for j in range(4):
                here = write.add(begin, k, j * width)
                total = write.product_sum(
                    by_first, write.load(2, write.add(first, k, j * width), width), write.load(0, here, width)
                )
                total = write.product_sum(by_second, write.load(2, write.add(second, k, j * width), width), total)
                write.store(0, here, total)
        return call[0].get_dummy_value()

    return types.void(to, begin, stored, first, second, by_first, by_second, count), build


@inlined
def _dot(left: Any, at: int, right: Any, begin: int, count: int) -> Any:
    whole = count // FOURS * FOURS
    total = _products(left, at, right, begin, whole)
    for k in range(whole, count):
        total += left[at + k] * right[begin + k]
    return total


@compiled
def _dots(start: int, stop: int, n: int, new: Any, old: Any, directions: Any, stored: Any, found: Any) -> None:
    """To rows of ``found`` (B, 2m + 4), what :meth:`Vectors.dots` returns; of arrays (…,) with all vectors in a row."""
    both = found.shape[1] - BESIDE
    whole = n // FOURS * FOURS
    flat = found.reshape(-1)
    for i in range(start, stop):
        begin, at = i * n, i * found.shape[1] + both
        _changes(new, old, directions, begin, whole, flat, at)
        for k in range(begin + whole, begin + n):
            change = new[k] - old[k]
            flat[at + ALONG] += new[k] * directions[k]
            flat[at + CHANGE_ALONG] += change * directions[k]
            flat[at + CHANGE_SQUARED] += change * change
            flat[at + CHANGE_WITH_NEW] += change * new[k]
        found[i, :both] = 0
        for piece in range(0, n, PIECE):
            count = min(PIECE, n - piece)
            for k in range(both):
                found[i, k] += _dot(stored, (i * both + k) * n + piece, new, begin + piece, count)


@inlined
def _remainder(
    begin: int, whole: int, end: int, step: Any, by: Any, new: Any, xs: Any, gradients: Any, directions: Any
) -> Any:
    """What :func:`_step` does, for the numbers that are left."""
    largest = step - step
    for k in range(whole, end):
        x = begin + k
        xs[x] += step * directions[x]
        gradients[x], directions[x] = new[x], by * new[x]
        largest = max(largest, abs(new[x]))
    return largest


@inlined
def _combine(begin: int, count: int, first: int, n: int, coefficients: Any, stored: Any, directions: Any) -> None:
    """Adds stored vectors, the first of which has its share from ``first`` on, to ``count`` numbers of a direction."""
    m, whole = len(coefficients) // 2, count // FOURS * FOURS
    for k in range(m):
        s, y, by_s, by_y = first + k * n, first + (k + m) * n, coefficients[k], coefficients[k + m]
        _add_pair(directions, begin, stored, s, y, by_s, by_y, whole)
        for x in range(whole, count):
            directions[begin + x] += by_s * stored[s + x] + by_y * stored[y + x]


@compiled
def _move(
    start: int,
    stop: int,
    taken: Any,
    places: Any,
    coefficients: Any,
    new: Any,
    xs: Any,
    gradients: Any,
    directions: Any,
    stored: Any,
    slopes: Any,
    peaks: Any,
) -> None:
    """What :meth:`Vectors.move` does for some problems; all vectors of arrays (…,) in a row."""
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
                    _store_pair(new, gradients, directions, begin, step, stored, s, y, whole)
                    for x in range(whole, count):
                        stored[s + x] = step * directions[begin + x]
                        stored[y + x] = new[begin + x] - gradients[begin + x]
                peak = max(peak, _step(xs, directions, begin, step, new, gradients, by, whole))
                peak = max(peak, _remainder(begin, whole, count, step, by, new, xs, gradients, directions))
                _combine(begin, count, first, n, coefficients[i, :both], stored, directions)
                slope += _dot(gradients, begin, directions, begin, count)
            slopes[i], peaks[i] = slope, peak


class CompiledVectors(Vectors):
    """In loops, in as many threads as PyTorch takes: what a problem needs stays in the caches until it has moved on."""

    def dots(self, trial_gradient: Tensor) -> Tensor:
        found = self.x.new_empty(len(self.x), self.stored.shape[1] + BESIDE)
        vectors = (trial_gradient, self.gradient, self.direction, self.stored)
        arrays = *(each.view(-1).numpy() for each in vectors), found.numpy()
        share_out(lambda start, stop: _dots(start, stop, self.x.shape[1], *arrays), len(found))
        return found

    def move(
        self, taken: Tensor, places: Tensor, coefficients: Tensor, trial_gradient: Tensor, slopes: Tensor, peaks: Tensor
    ) -> None:
        vectors = (trial_gradient, self.x, self.gradient, self.direction, self.stored)
        numbers = (taken.numpy(), places.numpy(), coefficients.numpy())
        arrays = *(each.view(-1).numpy() for each in vectors), slopes.numpy(), peaks.numpy()
        share_out(lambda start, stop: _move(start, stop, *numbers, *arrays), len(taken))
