"""The instructions of block normalisers: sums over the histograms of a block, and what becomes of each number.

A block is ``high`` rows of ``count`` numbers, ``of_row`` apart in the histograms and side by side elsewhere.  Eight
numbers go at a time, so rows have eight or more; the last eight of a row may overlap those before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, Lanes


class _Block:
    """Goes over a block, of arguments that begin with (histograms, at, of_row, high, count)."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        self.write = Builder(context, builder, signature, arguments)
        self.type = self.write.vector(self.write.number(0), 8)

    def number(self, which: int) -> Lanes:
        """An argument, eight times."""
        return Lanes(self.write, self.write.splat(self.write.arguments[which], 8))

    @contextmanager
    def eights(self) -> Iterator[tuple[Any, Any, Lanes]]:
        """For each eight: their place in the histograms, their place in the block, and which are not seen yet."""
        from numba.core import cgutils

        write, builder = self.write, self.write.builder
        at, of_row, high, count = write.arguments[1:5]
        index = write.vector(write.ir.IntType(64), 8)
        each = write.ir.Constant(index, list(range(8)))
        begin = builder.sub(count, write.whole(8))
        with (
            cgutils.for_range(builder, high) as row,
            cgutils.for_range_slice(builder, write.whole(0), count, write.whole(8)) as (k, _),
        ):
            x = builder.select(builder.icmp_signed("<", k, begin), k, begin)
            fresh = builder.icmp_signed(">=", each, write.splat(builder.sub(k, x), 8))
            here = write.add(at, write.times(row.index, of_row), x)
            yield here, write.add(write.times(row.index, count), x), Lanes(write, fresh)

    def load(self, which: int, at: Any) -> Lanes:
        return Lanes(self.write, self.write.load(which, at, 8))

    def sum_(self) -> tuple[Callable[[Lanes], None], Callable[[], Any]]:
        """A sum of eights: what adds to it, and what tells the total."""
        builder = self.write.builder
        place = self.write.variable(self.type)
        builder.store(self.write.zeros(self.type), place)

        def add(values: Lanes) -> None:
            builder.store(builder.fadd(builder.load(place), values.value), place)

        return add, lambda: self.write.total(builder.load(place))


def _scaled(*call: Any, root: bool) -> Any:
    block = _Block(*call)
    factor = block.number(5)
    with block.eights() as (here, place, _):
        values = block.load(0, here) * factor
        block.write.store(
            6, block.write.add(block.write.arguments[7], place), (values.sqrt() if root else values).value
        )
    return call[0].get_dummy_value()


@instruction
def scale_block(_: Any, of: Any, at: Any, of_row: Any, high: Any, count: Any, factor: Any, found: Any, to: Any) -> Any:
    """To ``found[to:]``, a block times a factor."""
    from numba.core import types

    return types.void(of, at, of_row, high, count, factor, found, to), partial(_scaled, root=False)


@instruction
def root_block(_: Any, of: Any, at: Any, of_row: Any, high: Any, count: Any, factor: Any, found: Any, to: Any) -> Any:
    """To ``found[to:]``, the roots of a block times a factor."""
    from numba.core import types

    return types.void(of, at, of_row, high, count, factor, found, to), partial(_scaled, root=True)


@instruction
def clip_block(_: Any, of: Any, at: Any, of_row: Any, high: Any, count: Any, factor: Any, clip: Any, found: Any) -> Any:
    """To ``found``, a block times a factor, clipped; returns the sum of their squares."""

    def build(*call: Any) -> Any:
        block = _Block(*call)
        factor, clip = block.number(5), block.number(6)
        add, total = block.sum_()
        with block.eights() as (here, place, fresh):
            values = block.load(0, here) * factor
            values = values.compare(">", clip).where(clip, values)
            block.write.store(7, place, values.value)
            add(fresh.where(values * values, 0.0))
        return total()

    return of.dtype(of, at, of_row, high, count, factor, clip, found), build


@instruction
def clipped_products(
    _: Any,
    of: Any,
    at: Any,
    of_row: Any,
    high: Any,
    count: Any,
    factor: Any,
    clip: Any,
    given: Any,
    begin: Any,
    found: Any,
) -> Any:
    """To ``found``, for a block times a factor, clipped: the sums of their squares and of products with ``given``."""
    from numba.core import types

    def build(*call: Any) -> Any:
        block = _Block(*call)
        write, factor, clip = block.write, block.number(5), block.number(6)
        (add_square, squares), (add_product, products) = block.sum_(), block.sum_()
        with block.eights() as (here, place, fresh):
            values = block.load(0, here) * factor
            values = fresh.where(values.compare(">", clip).where(clip, values), 0.0)
            add_square(values * values)
            add_product(values * block.load(7, write.add(write.arguments[8], place)))
        for k, total in enumerate((squares, products)):
            write.builder.store(total(), write.place(9, write.whole(k), write.number(9)))
        return call[0].get_dummy_value()

    return types.void(of, at, of_row, high, count, factor, clip, given, begin, found), build


@instruction
def clip_vjp(
    _: Any,
    of: Any,
    at: Any,
    of_row: Any,
    high: Any,
    count: Any,
    factor: Any,
    clip: Any,
    given: Any,
    begin: Any,
    by_given: Any,
    by_own: Any,
    found: Any,
) -> Any:
    """To ``found``, what reaches a block times a factor before it is clipped; returns the sum of its products with the
    block.

    Behind the clip, ``given`` times ``by_given`` less the clipped times ``by_own`` reach it.  At the clip itself, the
    mean of both sides passes.
    """

    def build(*call: Any) -> Any:
        block = _Block(*call)
        write, factor, clip = block.write, block.number(5), block.number(6)
        by_given, by_own = block.number(9), block.number(10)
        add, total = block.sum_()
        with block.eights() as (here, place, fresh):
            values = block.load(0, here)
            unit = values * factor
            above = unit.compare(">", clip)
            given = block.load(7, write.add(write.arguments[8], place))
            reached = given * by_given - above.where(clip, unit) * by_own
            reached = unit.compare("==", clip).where(reached * 0.5, reached)
            reached = above.where(0.0, reached)
            write.store(11, place, reached.value)
            add(fresh.where(reached * values, 0.0))
        return total()

    return of.dtype(of, at, of_row, high, count, factor, clip, given, begin, by_given, by_own, found), build


@instruction
def root_vjp(
    _: Any, of: Any, at: Any, of_row: Any, high: Any, count: Any, factor: Any, given: Any, begin: Any, found: Any
) -> Any:
    """The same before roots are taken; none of zero."""

    def build(*call: Any) -> Any:
        block = _Block(*call)
        write, factor = block.write, block.number(5)
        add, total = block.sum_()
        with block.eights() as (here, place, fresh):
            values = block.load(0, here)
            root = (values * factor).sqrt()
            reached = block.load(6, write.add(write.arguments[7], place)) * 0.5 / root
            reached = root.compare(">", 0.0).where(reached, 0.0)
            write.store(8, place, reached.value)
            add(fresh.where(reached * values, 0.0))
        return total()

    return of.dtype(of, at, of_row, high, count, factor, given, begin, found), build


@instruction
def product(_: Any, of: Any, at: Any, of_row: Any, high: Any, count: Any, given: Any, begin: Any) -> Any:
    """The sum of products of a block and ``given[begin:]``."""

    def build(*call: Any) -> Any:
        block = _Block(*call)
        write = block.write
        add, total = block.sum_()
        with block.eights() as (here, place, fresh):
            reached = block.load(5, write.add(write.arguments[6], place))
            add(fresh.where(block.load(0, here) * reached, 0.0))
        return total()

    return of.dtype(of, at, of_row, high, count, given, begin), build


@instruction
def add_normalised_vjp(
    _: Any,
    of: Any,
    at: Any,
    of_row: Any,
    high: Any,
    count: Any,
    given: Any,
    begin: Any,
    by_given: Any,
    by_own: Any,
    less: Any,
    found: Any,
) -> Any:
    """Adds ``given[begin:]`` times ``by_given``, less the block times ``by_own`` and ``less``, to ``found``."""
    from numba.core import types

    def build(*call: Any) -> Any:
        block = _Block(*call)
        write, by_given, by_own, less = block.write, block.number(7), block.number(8), block.number(9)
        with block.eights() as (here, place, fresh):
            reached = block.load(5, write.add(write.arguments[6], place)) * by_given
            reached = reached - (block.load(0, here) * by_own + less)
            write.store(10, here, (block.load(10, here) + fresh.where(reached, 0.0)).value)
        return call[0].get_dummy_value()

    return types.void(of, at, of_row, high, count, given, begin, by_given, by_own, less, found), build
