"""The vjp of :mod:`.pooling_simd` in vector instructions: from gradients of cells to gradients of each pixel's votes.

In two passes: gradients of cells are spread to columns of pixels; each pixel then reads those of three bins in its
column.  Together they gain 3.2 (AMD EPYC, AVX2, float32; hog's vjp of one image of 256 x 256, `paper`) over a plain
Numba loop in which each pixel reads all its cells.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ...runtime.lanes import Array, Builder, Lanes
from ...runtime.simd import vector_instruction

if TYPE_CHECKING:
    from llvmlite import ir

BESIDE = 3  # bins beside its own that a line of bins holds for a pixel: one before, two after


# in compiled functions of int, in instructions of LLVM's values
class Lines(NamedTuple):
    """Where lines of bins are."""

    at: int  # the first one
    line: int  # from column to column
    next_row: int  # from the upper to the lower row of cells


class PixelRun(NamedTuple):
    """Neighbouring pixels of a row."""

    first: int
    length: int


class ColumnWeights(NamedTuple):
    """Weights of a run's columns."""

    at: int  # of the first column in the left cell
    step: int  # from there to those in the right cell


def _spreads(cells: int, add: bool) -> Callable[..., None]:
    """An instruction: eight bins of one or two cells to eight columns, by the columns' weights.

    Bins of the first cell begin at ``grad_cells[at:]``, of the second ``line`` further.  Written, or if ``add`` added,
    to ``out[to:]``, ``line`` from column to column.
    """

    @vector_instruction
    def spread(
        write: Builder,
        grad_cells: Array,
        at: ir.Value,
        line: ir.Value,
        by_col: Array,
        weights: ColumnWeights,
        out: Array,
        to: ir.Value,
    ) -> None:
        values = [grad_cells.load(write.add(at, write.multiply(line, cell)), 8) for cell in range(cells)]
        for k in range(8):
            column = write.add(to, write.multiply(line, k))
            total = out.load(column, 8) if add else None
            for cell, value in enumerate(values):
                by = by_col.splat(write.add(weights.at, k, write.multiply(weights.step, cell)), 8)
                total = value * by if total is None else value.multiply_add(by, total)
            assert total is not None
            out.store(column, total)

    return spread


spread_eight, spread_eight_more, spread_eight_one_cell = _spreads(2, False), _spreads(2, True), _spreads(1, False)


def _reads(rows: int, add: bool) -> Callable[..., None]:
    """An instruction: gradients of a row of pixels' votes, for the bin before their own, their own and the next.

    ``lines`` are those of the pixels' columns in ``columns``, each beginning with the bin before the first.  ``bins``
    are the pixels' own; their number is rounded up to whole fours.  ``by_row[weight:]`` are the weights of the row of
    pixels in the rows of cells.  Written, or if ``add`` added, to three planes.
    """

    @vector_instruction
    def read(
        write: Builder,
        columns: Array,
        lines: Lines,
        bins: Array,
        pixels: PixelRun,
        by_row: Array,
        weight: ir.Value,
        before: Array,
        here: Array,
        after: Array,
    ) -> None:
        weights = [by_row.splat(write.add(weight, row), 4) for row in range(rows)]
        with write.loop(pixels.length, 4) as index:
            gradients: list[Lanes] = []
            for k in range(4):
                x = write.add(index, k)
                bin_ = write.builder.sext(bins.load_scalar(write.add(pixels.first, x)), write.ir.IntType(64))
                place = write.add(lines.at, write.multiply(x, lines.line), bin_)
                total = columns.load(place, 4) * weights[0]
                for row in range(1, rows):
                    total = columns.load(write.add(place, lines.next_row), 4).multiply_add(weights[row], total)
                gradients.append(total)
            place = write.add(pixels.first, index)
            for plane, values in zip((before, here, after), write.transpose(gradients)[:3], strict=True):
                plane.store(place, plane.load(place, 4) + values if add else values)

    return read


read_votes, read_votes_more, read_votes_one_row = _reads(2, False), _reads(2, True), _reads(1, False)
