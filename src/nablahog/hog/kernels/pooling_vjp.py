"""The vjp of Eq. 5-6: from gradients of cell histograms to gradients of the votes of pixels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Integers
from ...runtime.compile import borrowing, inlined
from ...runtime.simd import PADDING, aligned_zeros
from .cells import part_columns
from .parameters import Pooling
from .pooling_vjp_avx512 import look_up
from .pooling_vjp_simd import (
    BESIDE,
    ColumnWeights,
    Lines,
    PixelRun,
    read_votes,
    read_votes_more,
    read_votes_one_row,
    spread_eight,
    spread_eight_more,
    spread_eight_one_cell,
)


class VoteGradients(NamedTuple):
    """Planes: the gradient of a pixel's vote for the bin before its own, its own, and the next."""

    before: Floats
    here: Floats
    after: Floats


class CellGradients(NamedTuple):
    """Workspace: gradients of a band's cells.

    A line is the bins of a cell, with the last one in front, the first one behind, and padding to whole eights.
    """

    cells: Floats  # (high, columns + wide + 1, line)
    columns: Floats  # (high · columns of a part · line,): the same of columns of pixels


def new_vote_gradients(size: int, dtype: DType) -> VoteGradients:
    return VoteGradients(aligned_zeros(size, dtype), aligned_zeros(size, dtype), aligned_zeros(size, dtype))


def new_cell_gradients(pooling: Pooling, dtype: DType) -> CellGradients:
    line = (pooling.bins + BESIDE + 7) // 8 * 8
    shape = pooling.high, pooling.cols + pooling.wide + 1, line  # tables end behind the last cell
    columns = aligned_zeros(pooling.high * (pooling.columns + PADDING) * line, dtype)
    return CellGradients(aligned_zeros(math.prod(shape), dtype).reshape(shape), columns)


@borrowing
def wrap_bins(grad_cells: Floats, pooling: Pooling, band: int, out: Floats) -> None:
    """Copies the cells of a band from ``grad_cells`` (rows · cols · bins,) to lines of cyclic bins, ``out``."""
    bins, line, cols = pooling.bins, out.shape[2], pooling.cols
    target = out.reshape(-1)
    for k in range(pooling.high):
        row, to = pooling.bands[band, 2] + k, np.uintp(k * out.shape[1] * line)
        if row >= pooling.rows:
            out[k] = 0
            continue
        at = np.uintp(row * cols * bins)
        for _ in range(cols):
            for bin_ in range(bins):
                target[to + np.uintp(bin_ + 1)] = grad_cells[at + np.uintp(bin_)]
            target[to] = grad_cells[at + np.uintp(bins - 1)]
            target[to + np.uintp(bins + 1)] = grad_cells[at]
            to, at = to + np.uintp(line), at + np.uintp(bins)


@inlined
def _spread(cells: Floats, part: int, pooling: Pooling, out: Floats) -> None:
    """From lines of cells to lines of the columns of a part, ``out``."""
    line, wide, length, by_col = cells.shape[2], pooling.wide, pooling.length, pooling.by_col
    row_size, cells_size, source = out.size // pooling.high, cells.shape[1] * line, cells.reshape(-1)
    first, last = pooling.parts[part]
    begin = pooling.runs[first, 0]
    for run in range(first, last):  # in order: what is written behind the last column of one belongs to the next
        start, stop, cell = pooling.runs[run]
        for x in range(0, stop - start, 8):
            weight, column = run * wide * length + x, (start - begin + x) * line
            weights = ColumnWeights(weight, length)
            for row in range(pooling.high):
                for k in range(0, line, 8):
                    at, to = row * cells_size + cell * line + k, row * row_size + column + k
                    if wide == 1:
                        spread_eight_one_cell(source, at, line, by_col, weights, out, to)
                    else:
                        spread_eight(source, at, line, by_col, weights, out, to)
                    for pair in range(2, wide, 2):
                        beside, further = at + pair * line, ColumnWeights(weight + pair * length, length)
                        spread_eight_more(source, beside, line, by_col, further, out, to)


@inlined
def _look_up(
    cells: Floats, bins: Integers, stride: int, first: int, rows: int, pooling: Pooling, out: VoteGradients
) -> None:
    """As :func:`votes_gradient`, where tables hold the gradients."""
    line, by_row, by_col, length = cells.shape[2], pooling.by_row, pooling.by_col, pooling.length
    row_size, source = cells.shape[1] * line, cells.reshape(-1)
    for row in range(rows):  # what is written behind the last column of a run belongs to the next run or row
        for run in range(pooling.runs.shape[0]):
            start, stop, cell = pooling.runs[run]
            lines, pixels = Lines(cell * line, line, row_size), PixelRun(row * stride + start, stop - start)
            weights = ColumnWeights(run * 2 * length, length)
            planes = out.before, out.here, out.after
            look_up(source, lines, bins, pixels, by_col, weights, by_row, (first + row) * 2, *planes)


@borrowing
def votes_gradient(
    gradients: CellGradients, bins: Integers, stride: int, first: int, rows: int, pooling: Pooling, out: VoteGradients
) -> None:
    """Gradients of the votes of a band's ``rows`` from the ``first`` on, to planes of rows ``stride`` apart.

    ``bins`` is the plane of the pixels' own bins.
    """
    if pooling.look_up:
        _look_up(gradients.cells, bins, stride, first, rows, pooling, out)
        return
    high, line, by_row, columns = pooling.high, gradients.cells.shape[2], pooling.by_row, gradients.columns
    row_size = columns.size // high
    planes = out.before, out.here, out.after
    for part in range(pooling.parts.shape[0]):
        begin, end = part_columns(pooling, part)
        _spread(gradients.cells, part, pooling, columns)
        for row in range(rows):
            weight, pixels = (first + row) * high, PixelRun(row * stride + begin, end - begin)
            lines = Lines(0, line, row_size)
            if high == 1:
                read_votes_one_row(columns, lines, bins, pixels, by_row, weight, *planes)
            else:
                read_votes(columns, lines, bins, pixels, by_row, weight, *planes)
            for pair in range(2, high, 2):
                further = Lines(pair * row_size, line, row_size)
                read_votes_more(columns, further, bins, pixels, by_row, weight + pair, *planes)
