"""Eq. 5-6: votes of a band of rows of pixels summed up over rows and columns, with the weights of each.

Every bin looks at every vote and takes what is its own.  As no vote looks up where to add, many pixels go at a time,
and their sums stay in registers until the band ends.  Then columns are summed up, eight by eight.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, lanes, taking

BINS = 9  # that are summed up at a time


def _sum(
    context: Any, builder: Any, signature: Any, arguments: Any, shifts: tuple[int, ...], rows_of_cells: int
) -> Any:
    """Sums of planes' columns, each of which a pixel adds so many bins after its own."""
    from numba.core import cgutils

    write = Builder(context, builder, signature, arguments)
    bins, shares, sums = len(shifts), len(shifts) + 4, len(shifts) + 10
    at, step, rows = arguments[bins + 1 : bins + 4]
    share, high, first, last, count = arguments[shares + 1 : shares + 6]
    to, line, of_row = arguments[sums + 1 :]
    columns = lanes(write.size(sums))
    vector = write.vector(write.number(sums), columns)
    zero = write.zeros(vector)
    totals = [[write.variable(vector) for _ in range(rows_of_cells)] for _ in range(BINS)]
    for of_bin in totals:
        for total in of_bin:
            builder.store(zero, total)
    whole = write.ir.IntType(32)
    begin, all_ = (write.splat(builder.trunc(each, whole), columns) for each in (first, write.add(last, 1)))
    with cgutils.for_range(builder, rows) as loop:
        place = write.add(at, write.times(loop.index, step))
        after_first = builder.sub(write.load(bins, place, columns), begin)
        votes = [write.load(k, place, columns) for k in range(bins)]
        if len(votes) == 2:  # a magnitude, and how much of it belongs to the next bin
            far = builder.fmul(*votes)
            votes = [builder.fsub(votes[0], far), far]
        weights = write.add(share, write.times(loop.index, high))
        weights = [
            write.splat(write.load_one(shares, write.add(weights, row)), columns) for row in range(rows_of_cells)
        ]

        def belongs_to(k: int) -> Any:
            """Whether a pixel's bin is the k-th after the first, or before: bins go round."""
            kth = write.ir.Constant(after_first.type, [k] * columns)
            beyond = [builder.add(kth, all_)] if k < 0 or min(shifts) < 0 else []
            beyond += [builder.sub(kth, all_)] if min(shifts) < 0 else []
            found = builder.icmp_signed("==", after_first, kth)
            for other in beyond:
                found = builder.or_(found, builder.icmp_signed("==", after_first, other))
            return found

        mine = {k: belongs_to(k) for k in range(-max(shifts), BINS - min(shifts))}
        for k, of_bin in enumerate(totals):
            vote = zero
            for values, shift in zip(votes, shifts, strict=True):
                if len(votes) < 3:
                    vote = builder.select(mine[k - shift], values, vote)
                else:  # of few bins, one may be two of them
                    vote = builder.fadd(vote, builder.select(mine[k - shift], values, zero))
            for total, weight in zip(of_bin, weights, strict=True):
                builder.store(write.product_sum(vote, weight, builder.load(total)), total)
    for k, of_bin in enumerate(totals):
        with builder.if_then(builder.icmp_signed("<", write.whole(k), count)):
            for row, total in enumerate(of_bin):
                place = write.add(to, write.times(line, k), write.times(of_row, row))
                write.store(sums, place, builder.load(total))
    return context.get_dummy_value()


def _sums(shifts: tuple[int, ...], rows_of_cells: int) -> Any:
    """An instruction: the votes of as many columns as go at a time, to ``count`` bins of one or two rows of cells.

    Its arguments, in this order:

    * planes: of each shift, what pixels vote with for the bin so far from their own; if there are two shifts, the
      magnitude instead, and how much of it belongs to the next bin.  And which bins are the pixels' own.
    * at: the first pixel of the first row of pixels; step: from row to row; rows: how many.
    * shares: weights of rows; share: of the first, in the first row of cells; high: from row to row.
    * first: bin; last: of all bins; count: of bins that are wanted, :data:`BINS` at most.
    * sums: to write; to: the place of the first column in the first bin's line; line: from bin to bin; of_row: from one
      row of cells to the other.
    """

    def sums(_: Any, *arguments: Any) -> Any:
        return taking(arguments, partial(_sum, shifts=shifts, rows_of_cells=rows_of_cells))

    return instruction(sums)


sum_hard, sum_hard_once = _sums((0,), 2), _sums((0,), 1)
sum_linear, sum_linear_once = _sums((0, 1), 2), _sums((0, 1), 1)
sum_changes, sum_changes_once = _sums((0, 1, -1), 2), _sums((0, 1, -1), 1)


def _pool(context: Any, builder: Any, signature: Any, arguments: Any, cells: int) -> Any:
    write = Builder(context, builder, signature, arguments)
    (at, line), (share, step), (to, next_) = arguments[1:3], arguments[4:6], arguments[7:]
    columns = write.transposed([write.load(0, write.add(at, write.times(line, k)), 8) for k in range(8)])
    for cell in range(cells):
        begin, place = write.add(share, write.times(step, cell)), write.add(to, write.times(next_, cell))
        total = write.load(6, place, 8)
        for k, column in enumerate(columns):
            weight = write.splat(write.load_one(3, write.add(begin, k)), 8)
            total = write.product_sum(column, weight, total)
        write.store(6, place, total)
    return context.get_dummy_value()


@instruction
def pool_eight(
    _: Any, sums: Any, at: Any, line: Any, shares: Any, share: Any, step: Any, cells: Any, to: Any, next_: Any
) -> Any:
    """Adds eight columns of eight lines of sums from ``sums[at:]`` on to two cells, each by its own weights.

    The weights of the columns for the first cell begin at ``shares[share:]``, for the second ``step`` further; eight
    numbers of the first cell are at ``cells[to:]``, of the second ``next_`` further.
    """
    from numba.core import types

    return types.void(sums, at, line, shares, share, step, cells, to, next_), partial(_pool, cells=2)


@instruction
def pool_eight_once(
    _: Any, sums: Any, at: Any, line: Any, shares: Any, share: Any, step: Any, cells: Any, to: Any, next_: Any
) -> Any:
    """The same to the first cell only."""
    from numba.core import types

    return types.void(sums, at, line, shares, share, step, cells, to, next_), partial(_pool, cells=1)
