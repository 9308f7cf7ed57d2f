"""The jvp of Eq. 1-6 in one pass: tangents of images to tangents of cell histograms."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Integers, Real
from ...runtime.compile import borrowing, inlined
from ...runtime.simd import PADDING, aligned_zeros, whole_vectors
from ..gradient import BLACK
from .cells import add_bands, new_sums, part_columns, pool
from .gradient_loops import (
    Gradients,
    gradient_of_row,
    gradients_of_rows,
    new_gradients,
    padded,
    stored_values,
)
from .norm_simd import copy
from .parameters import Pixels, Plan, Pooling, Reading
from .pooling_simd import BINS, BinRange, PixelRows, Place, RowWeights, sum_tangents, sum_tangents_one_row
from .votes import Votes, linear_votes, new_votes, vote


class VoteTangents(NamedTuple):
    """Planes: the tangent of a pixel's vote for its own bin, the next, and the one before."""

    here: Floats
    after: Floats
    before: Floats


class BandJvp(NamedTuple):
    """Workspace: what is known of a band, and the tangents of it."""

    gradients: Gradients
    tangents: Gradients  # of which ``winner`` is not used
    votes: Votes
    exact: Votes  # by the exact angle
    vote_tangents: VoteTangents
    sums: Floats
    cells: Floats  # (bands, …): tangents of the cells of all bands of an image


def new_band_jvp(plan: Plan, width: int, dtype: DType) -> BandJvp:
    """For images of that width."""
    pooling = plan.pooling
    rows, columns = pooling.most_rows, pooling.cols + pooling.wide
    size = rows * whole_vectors(width) + PADDING
    return BandJvp(
        new_gradients(plan.reading, width, rows, dtype),
        new_gradients(plan.reading, width, rows, dtype),
        new_votes(size, dtype),
        new_votes(size, dtype),
        VoteTangents(aligned_zeros(size, dtype), aligned_zeros(size, dtype), aligned_zeros(size, dtype)),
        new_sums(pooling, dtype),
        np.empty((len(pooling.bands), columns * pooling.column_size), dtype),
    )


@borrowing
def _read_row_jvp(pixels: Pixels, start: int, tangent: Floats, row: int, reading: Reading, work: Gradients) -> None:
    """Tangents of one row of pixels, ``tangent`` (channels, height, width), to lines of tangents of values."""
    width, values, lines = pixels.width, work.values, work.lines
    real, black = lines.dtype.type, lines.dtype.type(BLACK)
    half, zero = real(0.5), real(0)
    for channel in range(reading.weights.size):
        to = ((0 if reading.averaged else 3 * channel) + row % 3) * (width + 2)
        begin = start + channel * pixels.strides[1] + row * pixels.strides[2]
        first = channel == 0 or not reading.averaged
        weight = reading.weights[channel]
        if reading.sqrt:
            stored_values(pixels, begin, values)
        for x in range(width):
            slope = weight * reading.scale
            if reading.sqrt:
                value = reading.scale * values[x]
                slope = zero if value <= black else slope * half / math.sqrt(value)
            change = slope * tangent[channel, row, x]
            lines[to + x + 1] = change if first else lines[to + x + 1] + change
        lines[to], lines[to + width + 1] = lines[to + min(2, width)], lines[to + max(width - 1, 1)]


@borrowing
def _where_won(dx: Floats, dy: Floats, channel: int, winner: Integers, out_x: Floats, out_y: Floats) -> None:
    """Replaces tangents of gradients by the channel's where it won."""
    for x in range(out_x.size):
        out_x[x] = dx[x] if winner[x] == channel else out_x[x]
        out_y[x] = dy[x] if winner[x] == channel else out_y[x]


@inlined
def _gradients_jvp(
    pixels: Pixels, start: int, tangent: Floats, reading: Reading, rows: tuple[int, int], last_read: int, band: BandJvp
) -> int:
    """Tangents of the gradients of rows (first, last); returns the last row that was read."""
    width, stride = pixels.width, padded(pixels.width)
    of, winner = band.tangents, band.gradients.winner
    last_read = max(last_read, rows[0] - 2)
    for row in range(rows[0], rows[1]):
        while last_read < min(row + 1, pixels.height - 1):
            last_read += 1
            _read_row_jvp(pixels, start, tangent, last_read, reading, of)
        to = (row - rows[0]) * stride
        gradient_of_row(of.lines, pixels, 0, row, reading, of.gx, of.gy, to)
        for channel in range(1, reading.channels):
            gradient_of_row(of.lines, pixels, channel, row, reading, of.other_gx, of.other_gy, to)
            line = slice(to, to + width)
            _where_won(of.other_gx[line], of.other_gy[line], channel, winner[line], of.gx[line], of.gy[line])
    return last_read


@borrowing
def _magnitude_jvp(gradients: Gradients, tangents: Gradients, votes: Votes, hard: bool, out: VoteTangents) -> None:
    """Tangents of votes by that of the magnitude."""
    m, gx, gy, dx, dy = votes.m, gradients.gx, gradients.gy, tangents.gx, tangents.gy
    f, here, after, before = votes.f, out.here, out.after, out.before
    zero = m.dtype.type(0)
    for x in range(m.size):
        longer = (gx[x] * dx[x] + gy[x] * dy[x]) / m[x] if m[x] > zero else zero
        far = zero if hard else longer * f[x]
        here[x], after[x], before[x] = longer - far, far, zero


@borrowing
def _angle_jvp(
    gradients: Gradients, tangents: Gradients, m: Floats, exact: Votes, slope: Real, out: VoteTangents
) -> None:
    """Tangents of votes by that of the angle; on a bin centre the mean of both sides.  ``slope``: bins per radian."""
    gx, gy, dx, dy = gradients.gx, gradients.gy, tangents.gx, tangents.gy
    f, here, after, before = exact.f, out.here, out.after, out.before
    half, zero = m.dtype.type(0.5), m.dtype.type(0)
    for x in range(m.size):
        turned = slope * (gx[x] * dy[x] - gy[x] * dx[x]) / m[x] if m[x] > zero else zero
        centre = f[x] == zero
        here[x] = zero if centre else -turned
        after[x] = half * turned if centre else turned
        before[x] = -half * turned if centre else zero


@borrowing
def _pooling_jvp(
    tangents: VoteTangents,
    bins: Integers,
    stride: int,
    first: int,
    rows: int,
    pooling: Pooling,
    sums: Floats,
    band_cells: Floats,
) -> None:
    """Eq. 5-6 of tangents: adds them to the cells of a band."""
    high, count, last, by_row = pooling.high, pooling.bins, pooling.bins - 1, pooling.by_row
    size = padded(pooling.columns)
    planes = tangents.here, tangents.after, tangents.before, bins
    for part in range(pooling.parts.shape[0]):
        begin, end = part_columns(pooling, part)
        for row in range(0, high, 2):
            weights = RowWeights(first * high + row, high)
            for bin_ in range(0, count, BINS):
                few = BinRange(bin_, last, min(BINS, count - bin_))
                for x in range(begin, end, pooling.lanes):
                    place = Place((row * count + bin_) * size + x - begin, size, count * size)
                    if high == 1:
                        sum_tangents_one_row(*planes, PixelRows(x, stride, rows), by_row, weights, few, sums, place)
                    else:
                        sum_tangents(*planes, PixelRows(x, stride, rows), by_row, weights, few, sums, place)
        pool(sums, part, pooling, band_cells)


@borrowing
def _cells_jvp(pixels: Pixels, start: int, tangent: Floats, plan: Plan, reading_jvp: Reading, band: BandJvp) -> None:
    """Tangents of the cells of one image, to ``band.cells``."""
    stride, voting, pooling = padded(pixels.width), plan.voting, plan.pooling
    gradients, tangents, votes, exact = band.gradients, band.tangents, band.votes, band.exact
    last_read, last_tangent, out = -1, -1, band.cells
    for k in range(pooling.bands.shape[0]):
        first, last, _ = pooling.bands[k]
        rows = last - first
        last_read = gradients_of_rows(pixels, start, plan.reading, first, last, last_read, gradients, 0)
        vote(gradients.gx, gradients.gy, voting, votes.m, votes.f, votes.bins)
        last_tangent = _gradients_jvp(pixels, start, tangent, reading_jvp, (first, last), last_tangent, band)
        out[k] = 0
        _magnitude_jvp(gradients, tangents, votes, voting.hard, band.vote_tangents)
        _pooling_jvp(band.vote_tangents, votes.bins, stride, first, rows, pooling, band.sums, out[k])
        if voting.hard:
            continue
        if voting.library_angle:
            linear_votes(gradients.gx, gradients.gy, voting, exact.m, exact.f, exact.bins)
        else:
            copy(votes.f, 0, votes.f.size, exact.f, 0)
            copy(votes.bins, 0, votes.bins.size, exact.bins, 0)
        _angle_jvp(gradients, tangents, votes.m, exact, voting.slope, band.vote_tangents)
        _pooling_jvp(band.vote_tangents, exact.bins, stride, first, rows, pooling, band.sums, out[k])


@borrowing
def cells_jvp_of_images(
    pixels: Pixels,
    tangents: Floats,
    plan: Plan,
    reading_jvp: Reading,
    images: tuple[int, int],
    band: BandJvp,
    out: Floats,
) -> None:
    """Tangents of cells of images (first, last), to ``out`` (images, rows · cols · bins).

    ``tangents`` are (images, channels, height, width), of the pixels; ``reading_jvp`` is as ``plan.reading``, but for
    images beyond whose border everything is zero.
    """
    for image in range(images[0], images[1]):
        _cells_jvp(pixels, image * pixels.strides[0], tangents[image], plan, reading_jvp, band)
        add_bands(band.cells, plan.pooling, out[image])
