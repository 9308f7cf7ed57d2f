"""The adjoint of :mod:`.sums`: from what reaches cells to what reaches the votes of each pixel."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...compile import instruction
from .simd import Builder

BESIDE = 3  # bins that a pixel's line has beside its own: one before, two after


def _spread(context: Any, builder: Any, signature: Any, arguments: Any, more: bool) -> Any:
    write = Builder(context, builder, signature, arguments)
    (at, next_), (share, step), (to, line) = arguments[1:3], arguments[4:6], arguments[7:]
    left, right = write.load(0, at, 8), write.load(0, write.add(at, next_), 8)
    for k in range(8):
        place, column = write.add(share, k), write.add(to, write.times(line, k))
        by_left, by_right = (write.spread(write.load_one(3, each), 8) for each in (place, write.add(place, step)))
        if more:
            value = write.product_sum(left, by_left, write.load(6, column, 8))
        else:
            value = builder.fmul(left, by_left)
        write.store(6, column, write.product_sum(right, by_right, value))
    return context.get_dummy_value()


@instruction
def spread_eight(
    _: Any, cells: Any, at: Any, next_: Any, shares: Any, share: Any, step: Any, found: Any, to: Any, line: Any
) -> Any:
    """Eight numbers of two cells to each of eight columns, by the column's weights for both.

    The first cell's are at ``cells[at:]``, the second's ``next_`` further; the weights for the first begin at
    ``shares[share:]``, for the second ``step`` further; those of the columns go to ``found[to:]``, ``line`` apart.
    """
    from numba.core import types

    return types.void(cells, at, next_, shares, share, step, found, to, line), partial(_spread, more=False)


@instruction
def spread_eight_more(
    _: Any, cells: Any, at: Any, next_: Any, shares: Any, share: Any, step: Any, found: Any, to: Any, line: Any
) -> Any:
    """The same, added to what is there."""
    from numba.core import types

    return types.void(cells, at, next_, shares, share, step, found, to, line), partial(_spread, more=True)


def _read(context: Any, builder: Any, signature: Any, arguments: Any, more: bool) -> Any:
    from numba.core import cgutils

    write = Builder(context, builder, signature, arguments)
    (at, line, of_row), (first, count), share, to = arguments[1:4], arguments[5:7], arguments[8], arguments[12]
    weights = [write.spread(write.load_one(7, write.add(share, row)), 4) for row in range(2)]
    four = write.whole(4)
    with cgutils.for_range_slice(builder, write.whole(0), count, four, inc=True) as (index, _):
        pixels = []
        for k in range(4):
            x = write.add(index, k)
            bin_ = builder.sext(write.load_one(4, write.add(first, x)), write.ir.IntType(64))
            place = write.add(at, write.times(x, line), bin_)
            above, below = write.load(0, place, 4), write.load(0, write.add(place, of_row), 4)
            pixels.append(write.product_sum(below, weights[1], builder.fmul(above, weights[0])))
        for which, reached in zip((9, 10, 11), write.transposed(pixels)[:3], strict=True):
            place = write.add(to, index)
            value = builder.fadd(write.load(which, place, 4), reached) if more else reached
            write.store(which, place, value)
    return context.get_dummy_value()


@instruction
def read_votes(
    _: Any,
    spread: Any,
    at: Any,
    line: Any,
    of_row: Any,
    bins: Any,
    first: Any,
    count: Any,
    shares: Any,
    share: Any,
    before: Any,
    here: Any,
    after: Any,
    to: Any,
) -> Any:
    """What reaches a vote of each of ``count`` pixels for the bin before its own, its own, and the next.

    Args:
        spread: what reaches votes in a column, for either of two rows of cells.
        at: of the first column, of the bin before the first.
        line: from column to column.
        of_row: from one row of cells to the other.
        bins: of the pixels.
        first: the first pixel's.
        count: rounded up to whole fours.
        shares: weights of rows.
        share: of the pixels' row in the first row of cells; the second's is next to it.
        before, here, after: planes to write.
        to: the first pixel's place there.
    """
    from numba.core import types

    of_pixels = spread, at, line, of_row, bins, first, count, shares, share
    return types.void(*of_pixels, before, here, after, to), partial(_read, more=False)


@instruction
def read_votes_more(
    _: Any,
    spread: Any,
    at: Any,
    line: Any,
    of_row: Any,
    bins: Any,
    first: Any,
    count: Any,
    shares: Any,
    share: Any,
    before: Any,
    here: Any,
    after: Any,
    to: Any,
) -> Any:
    """The same, added to what is there."""
    from numba.core import types

    of_pixels = spread, at, line, of_row, bins, first, count, shares, share
    return types.void(*of_pixels, before, here, after, to), partial(_read, more=True)
