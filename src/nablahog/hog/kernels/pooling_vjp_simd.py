"""The adjoint of :mod:`.pooling_simd`: from what reaches cells to what reaches the votes of each pixel."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, taking

BESIDE = 3  # bins that a pixel's line has beside its own: one before, two after


def _spread(context: Any, builder: Any, signature: Any, arguments: Any, cells: int, more: bool) -> Any:
    write = Builder(context, builder, signature, arguments)
    (at, next_), (share, step), (to, line) = arguments[1:3], arguments[4:6], arguments[7:]
    values = [write.load(0, write.add(at, write.times(next_, cell)), 8) for cell in range(cells)]
    for k in range(8):
        column = write.add(to, write.times(line, k))
        total = write.load(6, column, 8) if more else None
        for cell, value in enumerate(values):
            weight = write.splat(write.load_one(3, write.add(share, k, write.times(step, cell))), 8)
            total = write.product_sum(value, weight, total) if total else builder.fmul(value, weight)
        write.store(6, column, total)
    return context.get_dummy_value()


def _spreads(cells: int, more: bool) -> Any:
    """An instruction: eight numbers of one or two cells to each of eight columns, by the columns' weights for them.

    Its arguments, in this order:

    * cells: the numbers; at: where the first cell's begin; next_: from there to the second's.
    * shares: weights of columns; share: of the first column for the first cell; step: from there to those for the
      second.
    * found: to write, or if ``more`` to add to; to: the first column's numbers; line: from column to column.
    """

    def spread(_: Any, *arguments: Any) -> Any:
        return taking(arguments, partial(_spread, cells=cells, more=more))

    return instruction(spread)


spread_eight, spread_eight_more, spread_eight_once = _spreads(2, False), _spreads(2, True), _spreads(1, False)


def _read(context: Any, builder: Any, signature: Any, arguments: Any, rows: int, more: bool) -> Any:
    from numba.core import cgutils

    write = Builder(context, builder, signature, arguments)
    (at, line, of_row), (first, count), share, to = arguments[1:4], arguments[5:7], arguments[8], arguments[12]
    weights = [write.splat(write.load_one(7, write.add(share, row)), 4) for row in range(rows)]
    with cgutils.for_range_slice(builder, write.whole(0), count, write.whole(4)) as (index, _):
        pixels = []
        for k in range(4):
            x = write.add(index, k)
            bin_ = builder.sext(write.load_one(4, write.add(first, x)), write.ir.IntType(64))
            place = write.add(at, write.times(x, line), bin_)
            total = builder.fmul(write.load(0, place, 4), weights[0])
            for row in range(1, rows):
                total = write.product_sum(write.load(0, write.add(place, of_row), 4), weights[row], total)
            pixels.append(total)
        for which, reached in zip((9, 10, 11), write.transposed(pixels)[:3], strict=True):
            place = write.add(to, index)
            value = builder.fadd(write.load(which, place, 4), reached) if more else reached
            write.store(which, place, value)
    return context.get_dummy_value()


def _reads(rows: int, more: bool) -> Any:
    """An instruction: what reaches the votes of a row of pixels for the bin before their own, their own, and the next.

    Its arguments, in this order:

    * spread: what reaches votes in a column, for one or either of two rows of cells; at: the first column, the bin
      before the first; line: from column to column; of_row: from one row of cells to the other.
    * bins: the pixels' own; first: the first pixel's; count: of pixels, which is rounded up to whole fours.
    * shares: weights of rows; share: of the pixels' row in the first row of cells, which the second's is next to.
    * before, here, after: planes to write, or if ``more`` to add to; to: the first pixel's place there.
    """

    def read(_: Any, *arguments: Any) -> Any:
        return taking(arguments, partial(_read, rows=rows, more=more))

    return instruction(read)


read_votes, read_votes_more, read_votes_once = _reads(2, False), _reads(2, True), _reads(1, False)
