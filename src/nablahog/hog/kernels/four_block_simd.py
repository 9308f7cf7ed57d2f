"""Eight bins at a time: the instructions of the four-block normaliser.  Lines are padded to whole eights with zeros."""

from __future__ import annotations

from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, Lanes


class _Eight(Builder):
    """Instructions on eight numbers."""

    def eight(self, which: int, at: Any) -> Lanes:
        """Of an array, from a place on."""
        return Lanes(self, self.load(which, at, 8))

    def all(self, which: int, index: int | None = None) -> Lanes:
        """An argument eight times, or the number of it with an index."""
        number = self.arguments[which] if index is None else self.load_one(which, self.whole(index))
        return Lanes(self, self.splat(number, 8))

    def clipped(self, entries: Lanes, clip: Lanes) -> Lanes:
        return entries.compare(">", clip).where(clip, entries)


@instruction
def dot_eight(_: Any, left: Any, at: Any, right: Any, beside: Any) -> Any:
    """The sum of eight products, of ``left[at:]`` and ``right[beside:]``."""

    def build(*call: Any) -> Any:
        write = _Eight(*call)
        return write.total((write.eight(0, write.arguments[1]) * write.eight(2, write.arguments[3])).value)

    return left.dtype(left, at, right, beside), build


@instruction
def total_of_eight(_: Any, of: Any, at: Any) -> Any:
    """The sum of ``of[at:]``, eight numbers."""

    def build(*call: Any) -> Any:
        write = _Eight(*call)
        return write.total(write.eight(0, write.arguments[1]).value)

    return of.dtype(of, at), build


@instruction
def clipped_sums(_: Any, entries: Any, at: Any, factors: Any, clip: Any, found: Any, to: Any) -> Any:
    """To ``found[to:]``: half the sum, over the four ``factors``, of ``entries[at:]`` times each, clipped."""
    from numba.core import types

    def build(*call: Any) -> Any:
        write = _Eight(*call)
        values, limit = write.eight(0, write.arguments[1]), write.all(3)
        a, b, c, d = (write.clipped(values * write.all(2, k), limit) for k in range(4))
        write.store(4, write.arguments[5], (((a + b) + (c + d)) * 0.5).value)
        return call[0].get_dummy_value()

    return types.void(entries, at, factors, clip, found, to), build


@instruction
def clipped_totals(_: Any, entries: Any, at: Any, factors: Any, clip: Any, totals: Any) -> Any:
    """Adds ``entries[at:]`` times each of four ``factors``, clipped, to that one's eight numbers of ``totals``."""
    from numba.core import types

    def build(*call: Any) -> Any:
        write = _Eight(*call)
        values, limit = write.eight(0, write.arguments[1]), write.all(3)
        for k in range(4):
            total = write.eight(4, write.whole(8 * k)) + write.clipped(values * write.all(2, k), limit)
            write.store(4, write.whole(8 * k), total.value)
        return call[0].get_dummy_value()

    return types.void(entries, at, factors, clip, totals), build


@instruction
def clipped_vjp(
    _: Any, entries: Any, at: Any, factors: Any, clip: Any, given: Any, step: Any, each: Any, totals: Any, found: Any
) -> Any:
    """What reaches ``entries[at:]``, added to ``found[at:]``, and the four ``factors``, added to ``totals``.

    The clipped entries of a block are reached by ``given[block · step + at:]`` and all alike by ``each[block]``.  At
    the clip itself, the mean of both sides passes.  A factor's total is the sum of its eight numbers of ``totals``.
    """
    from numba.core import types

    def build(*call: Any) -> Any:
        write = _Eight(*call)
        place, step = write.arguments[1], write.arguments[5]
        values, limit, found = write.eight(0, place), write.all(3), write.eight(8, place)
        for block in range(4):
            factor = write.all(2, block)
            product = values * factor
            reached = write.eight(4, place) + write.all(6, block)
            passed = product.compare("==", limit).where(reached * 0.5, reached)
            passed = product.compare(">", limit).where(0.0, passed)
            found = Lanes(write, write.product_sum(passed.value, factor.value, found.value))
            total = write.product_sum(passed.value, values.value, write.load(7, write.whole(8 * block), 8))
            write.store(7, write.whole(8 * block), total)
            place = write.add(place, step)
        write.store(8, write.arguments[1], found.value)
        return call[0].get_dummy_value()

    return types.void(entries, at, factors, clip, given, step, each, totals, found), build
