"""From what reaches cell histograms to what reaches the votes of pixels: the adjoint of Eq. 5-6."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...runtime.compile import compiled, inlined
from .pooling_vjp_avx512 import look_up
from .pooling_vjp_simd import (
    read_votes,
    read_votes_more,
    read_votes_once,
    spread_eight,
    spread_eight_more,
    spread_eight_once,
)


@compiled
def wrap_bins(given: Any, pooling: Any, band: int, found: Any) -> None:
    """What reaches the cells of a band, to ``found`` (high, columns + wide, line): a line begins with the last bin.

    ``given`` is (rows, columns, bins).
    """
    bins, line, cols = pooling.bins, found.shape[2], pooling.cols
    source, to_all = given.reshape(-1), found.reshape(-1)
    for k in range(pooling.high):
        row, to = pooling.bands[band, 2] + k, np.uintp(k * found.shape[1] * line)
        if row >= pooling.rows:
            found[k] = 0
            continue
        at = np.uintp(row * cols * bins)
        for _ in range(cols):
            for bin_ in range(bins):
                to_all[to + np.uintp(bin_ + 1)] = source[at + np.uintp(bin_)]
            to_all[to] = source[at + np.uintp(bins - 1)]
            to_all[to + np.uintp(bins + 1)] = source[at]
            to, at = to + np.uintp(line), at + np.uintp(bins)


@inlined
def _spread(cells: Any, part: int, pooling: Any, found: Any) -> None:
    """From cells (high, columns + wide, line) to the columns of a part, ``found``: (line) of each, row by row."""
    line, wide, length = cells.shape[2], pooling.wide, pooling.length
    of_row, of_cells, source = found.size // pooling.high, cells.shape[1] * line, cells.reshape(-1)
    first, last = pooling.parts[part]
    begin = pooling.runs[first, 0]
    for run in range(first, last):  # one after the other: what is written behind the last column of one is the next's
        start, stop, cell = pooling.runs[run]
        for x in range(0, stop - start, 8):
            share, column = run * wide * length + x, (start - begin + x) * line
            for row in range(pooling.high):
                for k in range(0, line, 8):
                    at, to = row * of_cells + cell * line + k, row * of_row + column + k
                    if wide == 1:
                        spread_eight_once(source, at, line, pooling.by_col, share, length, found, to, line)
                    else:
                        spread_eight(source, at, line, pooling.by_col, share, length, found, to, line)
                    for pair in range(2, wide, 2):
                        beside, weights = at + pair * line, share + pair * length
                        spread_eight_more(source, beside, line, pooling.by_col, weights, length, found, to, line)


@inlined
def _look_up(
    cells: Any, bins: Any, stride: int, first: int, rows: int, pooling: Any, before: Any, here: Any, after: Any
) -> None:
    """As :func:`read`, where tables hold what reaches the votes."""
    line, by_row, by_col, length = cells.shape[2], pooling.by_row, pooling.by_col, pooling.length
    of_row, source = cells.shape[1] * line, cells.reshape(-1)
    for row in range(rows):  # what is written behind the last column of a run is the next one's, or the next row's
        weight = (first + row) * 2
        for run in range(pooling.runs.shape[0]):
            start, stop, cell = pooling.runs[run]
            share, to = run * 2 * length, row * stride + start
            tables, pixels = (source, cell * line, line, of_row), (bins, to, stop - start)
            look_up(*tables, *pixels, by_col, share, length, by_row, weight, before, here, after, to)


@inlined
def read(
    cells: Any,
    bins: Any,
    stride: int,
    first: int,
    rows: int,
    pooling: Any,
    spread: Any,
    before: Any,
    here: Any,
    after: Any,
) -> None:
    """What reaches the votes of ``rows`` of pixels of a band, from the ``first`` on: planes of rows, ``stride`` apart.

    ``spread`` is overwritten.
    """
    if pooling.looked_up:
        _look_up(cells, bins, stride, first, rows, pooling, before, here, after)
        return
    high, line, by_row = pooling.high, cells.shape[2], pooling.by_row
    of_row = spread.size // high
    for part in range(pooling.parts.shape[0]):
        begin, end = pooling.runs[pooling.parts[part, 0], 0], pooling.runs[pooling.parts[part, 1] - 1, 1]
        _spread(cells, part, pooling, spread)
        for row in range(rows):
            share, at = (first + row) * high, row * stride + begin
            count = end - begin
            if high == 1:
                read_votes_once(spread, 0, line, of_row, bins, at, count, by_row, share, before, here, after, at)
            else:
                read_votes(spread, 0, line, of_row, bins, at, count, by_row, share, before, here, after, at)
            for pair in range(2, high, 2):
                begun, weights = pair * of_row, share + pair
                read_votes_more(spread, begun, line, of_row, bins, at, count, by_row, weights, before, here, after, at)
