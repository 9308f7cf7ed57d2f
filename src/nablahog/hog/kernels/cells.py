"""Eq. 1-6 in one pass over an image, a band of rows at a time: stored values to cell histograms.

The rows of a band vote into the same rows of cells.  Their votes are stored until the band is complete, then summed up
over rows and pooled over columns, a part of few columns at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats
from ...runtime.compile import borrowing, inlined
from ...runtime.simd import PADDING, aligned_zeros, whole_vectors
from .gradient_loops import Gradients, gradients_of_rows, new_gradients, padded
from .parameters import Pixels, Plan, Pooling
from .pooling_simd import (
    BINS,
    BinRange,
    PixelRows,
    Place,
    RowWeights,
    pool_eight,
    pool_eight_one_cell,
    sum_hard,
    sum_hard_one_row,
    sum_linear,
    sum_linear_one_row,
)
from .votes import Votes, new_votes, vote

PIXELS_AT_ONCE = 1024  # whose gradients and votes stay in the first-level cache


class Band(NamedTuple):
    """Workspace: what is known of a band."""

    gradients: Gradients  # of a few of its rows
    votes: Votes
    sums: Floats  # over rows, of one part: a line of columns for each bin of each row of cells


@inlined
def rows_at_once(stride: int) -> int:
    """Rows whose gradients are found before they vote."""
    return max(1, PIXELS_AT_ONCE // stride)


def new_sums(pooling: Pooling, dtype: DType) -> Floats:
    """Those of a :class:`Band`."""
    return aligned_zeros(pooling.column_size * whole_vectors(pooling.columns) + PADDING, dtype)


def new_band(plan: Plan, width: int, dtype: DType) -> Band:
    """For images of that width."""
    stride, most = whole_vectors(width), plan.pooling.most_rows
    few = min(max(1, PIXELS_AT_ONCE // stride), most)
    gradients, votes = new_gradients(plan.reading, width, few, dtype), new_votes(most * stride + PADDING, dtype)
    return Band(gradients, votes, new_sums(plan.pooling, dtype))


@borrowing
def pool(sums: Floats, part: int, pooling: Pooling, band_cells: Floats) -> None:
    """Adds the sums of a part's columns to ``band_cells`` (columns of cells, column_size), in one line."""
    size, wide, length, step = padded(pooling.columns), pooling.wide, pooling.length, pooling.column_size
    by_col = pooling.by_col
    first, last = pooling.parts[part]
    begin = pooling.runs[first, 0]
    for run in range(first, last):
        start, stop, cell = pooling.runs[run]
        for x in range(start, stop, 8):
            for pair in range(0, wide, 2):
                weights, to = (run * wide + pair) * length + x - start, (cell + pair) * step
                for k in range(0, step, 8):
                    at = k * size + x - begin
                    if wide == 1:
                        pool_eight_one_cell(sums, at, size, by_col, weights, length, band_cells, to + k, step)
                    else:
                        pool_eight(sums, at, size, by_col, weights, length, band_cells, to + k, step)


@inlined
def part_columns(pooling: Pooling, part: int) -> tuple[int, int]:
    """The first column of a part, and the one after its last."""
    return pooling.runs[pooling.parts[part, 0], 0], pooling.runs[pooling.parts[part, 1] - 1, 1]


@borrowing
def sum_up(
    votes: Votes, stride: int, first: int, rows: int, hard: bool, pooling: Pooling, sums: Floats, band_cells: Floats
) -> None:
    """Eq. 5-6: ``band_cells`` from the votes of a band's ``rows`` from the ``first`` on."""
    high, count, last, by_row = pooling.high, pooling.bins, pooling.bins - 1, pooling.by_row
    size = padded(pooling.columns)
    m, f, bins = votes.m, votes.f, votes.bins
    band_cells[:] = 0
    for part in range(pooling.parts.shape[0]):
        begin, end = part_columns(pooling, part)
        for row in range(0, high, 2):
            weights = RowWeights(first * high + row, high)
            for bin_ in range(0, count, BINS):
                few = BinRange(bin_, last, min(BINS, count - bin_))
                to = (row * count + bin_) * size - begin
                for x in range(begin, end, pooling.lanes):
                    pixels, place = PixelRows(x, stride, rows), Place(to + x, size, count * size)
                    if hard and high == 1:
                        sum_hard_one_row(m, bins, pixels, by_row, weights, few, sums, place)
                    elif hard:
                        sum_hard(m, bins, pixels, by_row, weights, few, sums, place)
                    elif high == 1:
                        sum_linear_one_row(m, f, bins, pixels, by_row, weights, few, sums, place)
                    else:
                        sum_linear(m, f, bins, pixels, by_row, weights, few, sums, place)
        pool(sums, part, pooling, band_cells)


@inlined
def _add_band(band_cells: Floats, band: int, pooling: Pooling, cells: Floats) -> None:
    """Eq. 6: adds the cells of a band to those of the image (rows · cols · bins,)."""
    bins, first = pooling.bins, pooling.bands[band, 2]
    for row in range(first, min(first + pooling.high, pooling.rows)):
        to, at = np.uintp(row * pooling.cols * bins), np.uintp((row - first) * bins)
        for _ in range(pooling.cols):
            for k in range(bins):
                cells[to + np.uintp(k)] += band_cells[at + np.uintp(k)]
            to, at = to + np.uintp(bins), at + np.uintp(pooling.column_size)


@borrowing
def add_bands(all_band_cells: Floats, pooling: Pooling, cells: Floats) -> None:
    """The cells of an image (rows · cols · bins,) from those of all its bands (bands, …)."""
    cells[:] = 0
    for band in range(pooling.bands.shape[0]):
        _add_band(all_band_cells[band], band, pooling, cells)


@borrowing
def cells_of_images(
    pixels: Pixels,
    plan: Plan,
    images: tuple[int, int],
    bands: tuple[int, int],
    work: Band,
    band_cells: Floats,
    cells: Floats,
) -> None:
    """Cells of images (first, last) and bands (first, last) of them, to ``cells`` (images, rows · cols · bins).

    ``band_cells`` (1, …) is overwritten.  If ``cells`` is of no images, it is (bands, …) and the result, of one image.
    """
    reading, voting, pooling = plan.reading, plan.voting, plan.pooling
    gradients, votes, sums = work.gradients, work.votes, work.sums
    stride = padded(pixels.width)
    few = min(rows_at_once(stride), pooling.most_rows)
    hard = voting.hard or pooling.bins == 1
    for image in range(images[0], images[1]):
        start, last_read = image * pixels.strides[0], -1
        for plane in (votes.m, votes.f, sums):  # a NaN left by the image before would not vanish by a weight of zero
            plane[:] = 0
        if cells.shape[0] > 0:
            cells[image] = 0
        for band in range(bands[0], bands[1]):
            first, last, _ = pooling.bands[band]
            for begin in range(first, last, few):
                end = min(begin + few, last)
                last_read = gradients_of_rows(pixels, start, reading, begin, end, last_read, gradients, 0)
                count, to = (end - begin) * stride, (begin - first) * stride
                _vote(gradients.gx[:count], gradients.gy[:count], plan, votes, to, count)
            of_band = band_cells[band % band_cells.shape[0]]
            sum_up(votes, stride, first, last - first, hard, pooling, sums, of_band)
            if cells.shape[0] > 0:
                _add_band(of_band, band, pooling, cells[image])


@inlined
def _vote(gx: Floats, gy: Floats, plan: Plan, votes: Votes, to: int, count: int) -> None:
    rows = slice(to, to + count)
    vote(gx, gy, plan.voting, votes.m[rows], votes.f[rows], votes.bins[rows])
