"""Eq. 5-6 in vector instructions: the votes of a band's rows summed up, then pooled over columns.

Gather, not scatter: each bin masks all votes of a vector of pixels, so lanes never conflict, and the sums stay in
registers until the band ends.  Gains are of a call of `hog`, one image of 256 x 256, AMD EPYC, AVX2, float32, over a
plain Numba loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ...runtime.lanes import Array, Builder, Lanes, Variable
from ...runtime.simd import lanes, vector_instruction

if TYPE_CHECKING:
    from llvmlite import ir

BINS = 9  # whose sums are in registers at a time


# in compiled functions of int, in instructions of LLVM's values
class PixelRows(NamedTuple):
    """A column of vectors of pixels."""

    at: int  # the first pixel of the first row
    stride: int  # from row to row
    rows: int


class RowWeights(NamedTuple):
    """Weights of rows of pixels in rows of cells."""

    at: int  # of the first row of pixels in the first row of cells; that in the second is beside it
    stride: int  # from row to row of pixels


class BinRange(NamedTuple):
    """Bins that are summed up."""

    first: int
    last: int  # of all bins of the dialect
    number: int  # at most BINS


class Place(NamedTuple):
    """Where sums go."""

    at: int  # of the first column and bin
    stride: int  # from bin to bin
    row_stride: int  # from the first to the second row of cells


def _masks(write: Builder, own: Lanes, bins: BinRange, shifts: tuple[int, ...]) -> dict[int, Lanes]:
    """For the k-th bin of the range, and bins beside it: the mask of pixels whose own bin it is.  Bins are cyclic."""
    after_first = own - write.splat_int32(bins.first, own.count)
    every = write.splat_int32(write.add(bins.last, 1), own.count)

    def mask(k: int) -> Lanes:
        kth = own.like(k)
        cyclic = [kth + every] if k < 0 or min(shifts) < 0 else []
        cyclic += [kth - every] if min(shifts) < 0 else []
        equal = after_first.compare("==", kth)
        for other in cyclic:
            equal = equal | after_first.compare("==", other)
        return equal

    return {k: mask(k) for k in range(-max(shifts), BINS - min(shifts))}


def _sums(shifts: tuple[int, ...], rows_of_cells: int) -> Callable[..., None]:
    """An instruction: sums up a column of vectors of pixels, into a range of bins of one or two rows of cells.

    A pixel votes into the bins at ``shifts`` from its own.  The instruction takes a plane of votes for each shift (of
    two shifts, of magnitudes and of the share f of the next bin), the plane of bins, ``PixelRows``, an array of weights
    and ``RowWeights``, ``BinRange``, and the array of sums with the ``Place`` in it.
    """

    @vector_instruction
    def sum_votes(write: Builder, *operands: Array | NamedTuple) -> None:
        *planes, bins, rows, by_row, weights, few, sums, to = operands
        _sum(write, shifts, rows_of_cells, planes, bins, rows, by_row, weights, few, sums, to)  # type: ignore[arg-type]

    return sum_votes


def _sum(
    write: Builder,
    shifts: tuple[int, ...],
    rows_of_cells: int,
    planes: list[Array],
    bins: Array,
    rows: PixelRows,
    by_row: Array,
    weights: RowWeights,
    few: BinRange,
    sums: Array,
    to: Place,
) -> None:
    count = lanes(sums.itemsize)
    zero = write.constant(sums.vector(count), 0.0)
    totals = [[Variable(zero) for _ in range(rows_of_cells)] for _ in range(BINS)]
    with write.loop(rows.rows) as row:
        at = write.add(rows.at, write.multiply(row, rows.stride))
        masks = _masks(write, bins.load(at, count), few, shifts)
        votes = [plane.load(at, count) for plane in planes]
        if len(votes) == 2:  # m and f
            far = votes[0] * votes[1]
            votes = [votes[0] - far, far]
        weight = write.add(weights.at, write.multiply(row, weights.stride))
        of_rows = [by_row.splat(write.add(weight, k), count) for k in range(rows_of_cells)]
        for k, of_bin in enumerate(totals):
            vote = zero
            for values, shift in zip(votes, shifts, strict=True):
                if len(votes) < 3:
                    vote = masks[k - shift].where(values, vote)
                else:  # of few bins, one may be at two shifts
                    vote = vote + masks[k - shift].where(values, zero)
            for total, of_row in zip(of_bin, of_rows, strict=True):
                total.set(vote.multiply_add(of_row, total.get()))
    for k, of_bin in enumerate(totals):
        with write.if_less(k, few.number):
            for row_of_cells, total in enumerate(of_bin):
                place = write.add(to.at, write.multiply(to.stride, k), write.multiply(to.row_stride, row_of_cells))
                sums.store(place, total.get())


# gain 4.2 (`paper`), together with those below, over a loop that scatters votes to cells
sum_hard, sum_hard_one_row = _sums((0,), 2), _sums((0,), 1)
sum_linear, sum_linear_one_row = _sums((0, 1), 2), _sums((0, 1), 1)
sum_tangents, sum_tangents_one_row = _sums((0, 1, -1), 2), _sums((0, 1, -1), 1)


def _pools(cells: int) -> Callable[..., None]:
    """An instruction: adds eight columns of eight lines of sums to one or two cells.  Gain 2.4 (`paper`).

    ``sums[at:]`` are the first line's, ``stride`` apart.  Weights of the columns in the first cell begin at
    ``by_col[weight:]``, in the second ``step`` further; eight bins of the first cell at ``out[to:]``, of the second
    ``next_cell`` further.
    """

    @vector_instruction
    def pool(
        write: Builder,
        sums: Array,
        at: ir.Value,
        stride: ir.Value,
        by_col: Array,
        weight: ir.Value,
        step: ir.Value,
        out: Array,
        to: ir.Value,
        next_cell: ir.Value,
    ) -> None:
        columns = write.transpose([sums.load(write.add(at, write.multiply(stride, k)), 8) for k in range(8)])
        for cell in range(cells):
            begin, place = write.add(weight, write.multiply(step, cell)), write.add(to, write.multiply(next_cell, cell))
            total = out.load(place, 8)
            for k, column in enumerate(columns):
                total = column.multiply_add(by_col.splat(write.add(begin, k), 8), total)
            out.store(place, total)

    return pool


pool_eight, pool_eight_one_cell = _pools(2), _pools(1)
