"""Eq. 5-6: votes of a band of rows of pixels summed up over rows and columns, with the weights of each.

Every bin looks at every vote and takes what is its own.  As no vote looks up where to add, many pixels go at a time, and
their sums stay in registers until the band ends.  Then columns are summed up, eight by eight.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from ...compile import instruction
from .simd import Builder, lanes

BINS = 9  # that are summed up at a time, for
ROWS = 2  # of cells


def _sum(context: Any, builder: Any, signature: Any, arguments: Any, shifts: tuple[int, ...]) -> Any:
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
    totals = [[cgutils.alloca_once(builder, vector) for _ in range(ROWS)] for _ in range(BINS)]
    for of_bin in totals:
        for total in of_bin:
            builder.store(zero, total)
    whole = write.ir.IntType(32)
    begin, all_ = (write.spread(builder.trunc(each, whole), columns) for each in (first, write.add(last, 1)))
    with cgutils.for_range(builder, rows) as loop:
        place = write.add(at, write.times(loop.index, step))
        after_first = builder.sub(write.load(bins, place, columns), begin)
        votes = [write.load(k, place, columns) for k in range(bins)]
        if len(votes) == 2:  # a magnitude, and how much of it belongs to the next bin
            far = builder.fmul(*votes)
            votes = [builder.fsub(votes[0], far), far]
        weights = write.add(share, write.times(loop.index, high))
        weights = [write.spread(write.load_one(shares, write.add(weights, row)), columns) for row in range(ROWS)]

        def is_(k: int) -> Any:
            """Whether a pixel's bin is the k-th after the first, or before: bins go round."""
            kth = write.ir.Constant(after_first.type, [k] * columns)
            beyond = [builder.add(kth, all_)] if k < 0 or min(shifts) < 0 else []
            beyond += [builder.sub(kth, all_)] if min(shifts) < 0 else []
            found = builder.icmp_signed("==", after_first, kth)
            for other in beyond:
                found = builder.or_(found, builder.icmp_signed("==", after_first, other))
            return found

        mine = {k: is_(k) for k in range(-max(shifts), BINS - min(shifts))}
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


@instruction
def sum_hard(
    _: Any,
    m: Any,
    bins: Any,
    at: Any,
    step: Any,
    rows: Any,
    shares: Any,
    share: Any,
    high: Any,
    first: Any,
    last: Any,
    count: Any,
    sums: Any,
    to: Any,
    line: Any,
    of_row: Any,
) -> Any:
    """Votes of as many columns as go at a time, to ``count`` bins and two rows of cells.

    Args:
        m: plane of what pixels vote with.
        bins: which bins they vote for.
        at: the first pixel of the first row.
        step: from row to row.
        rows: of pixels.
        shares: weights of rows.
        share: of the first row, in the first row of cells.
        high: from row to row.
        first: bin.
        last: of all bins.
        count: bins that are wanted, :data:`BINS` at most.
        sums: to write.
        to: the place of the first column in the first bin's line.
        line: from bin to bin.
        of_row: from one row of cells to the other.
    """
    from numba.core import types

    signature = types.void(m, bins, at, step, rows, shares, share, high, first, last, count, sums, to, line, of_row)
    return signature, partial(_sum, shifts=(0,))


@instruction
def sum_linear(
    _: Any,
    m: Any,
    f: Any,
    bins: Any,
    at: Any,
    step: Any,
    rows: Any,
    shares: Any,
    share: Any,
    high: Any,
    first: Any,
    last: Any,
    count: Any,
    sums: Any,
    to: Any,
    line: Any,
    of_row: Any,
) -> Any:
    """The same of votes of which ``f`` belong to the next bin."""
    from numba.core import types

    signature = types.void(m, f, bins, at, step, rows, shares, share, high, first, last, count, sums, to, line, of_row)
    return signature, partial(_sum, shifts=(0, 1))


@instruction
def sum_changes(
    _: Any,
    here: Any,
    after: Any,
    before: Any,
    bins: Any,
    at: Any,
    step: Any,
    rows: Any,
    shares: Any,
    share: Any,
    high: Any,
    first: Any,
    last: Any,
    count: Any,
    sums: Any,
    to: Any,
    line: Any,
    of_row: Any,
) -> Any:
    """The same of numbers for a bin, the one after it and the one before."""
    from numba.core import types

    of_rows = bins, at, step, rows, shares, share, high
    return types.void(here, after, before, *of_rows, first, last, count, sums, to, line, of_row), partial(
        _sum, shifts=(0, 1, -1)
    )


@instruction
def pool_eight(
    _: Any, sums: Any, at: Any, line: Any, shares: Any, share: Any, step: Any, cells: Any, to: Any, next_: Any
) -> Any:
    """Adds eight columns of eight lines of sums from ``sums[at:]`` on to two cells, each by its own weights.

    The weights of the columns for the first cell begin at ``shares[share:]``, for the second ``step`` further; eight
    numbers of the first cell are at ``cells[to:]``, of the second ``next_`` further.
    """
    from numba.core import types

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        write = Builder(context, builder, signature, arguments)
        (at, line), (share, step), (to, next_) = arguments[1:3], arguments[4:6], arguments[7:]
        columns = write.transposed([write.load(0, write.add(at, write.times(line, k)), 8) for k in range(8)])
        for cell in range(2):
            begin, place = write.add(share, write.times(step, cell)), write.add(to, write.times(next_, cell))
            total = write.load(6, place, 8)
            for k, column in enumerate(columns):
                weight = write.spread(write.load_one(3, write.add(begin, k)), 8)
                total = write.product_sum(column, weight, total)
            write.store(6, place, total)
        return context.get_dummy_value()

    return types.void(sums, at, line, shares, share, step, cells, to, next_), build
