"""What the compiled loops know of a dialect and an image size: numbers and tables, computed once for each pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from ...runtime.arrays import Bytes, Flags, Floats, Integers, Real
from ...runtime.simd import PADDING, lanes
from .. import library_angles
from ..gradient import BORDERS, GRAY_WEIGHTS, MASKS, last_of_equals
from ..orientation import beginnings, hard_directions, vanishing, vote_rule
from ..pooling import pooling_matrices
from ..spec import HOGSpec
from .pooling_vjp_avx512 import fits

LINEAR, OPENCV, VLFEAT, NEAREST, BEGUN = range(5)  # vote rules
_KINDS = {"linear": LINEAR, "opencv": OPENCV, "vlfeat": VLFEAT, "nearest": NEAREST, "begun": BEGUN}
_COLUMNS = 128  # of pixels that are pooled together: their sums stay in the first-level cache


class Pixels(NamedTuple):
    """A batch of images as stored, of any strides."""

    values: Floats  # (span,): the memory that the images lie in; empty if it holds bytes
    bytes: Bytes  # the same, of uint8; empty if it holds floating point
    height: int
    width: int
    strides: tuple[int, int, int, int]  # in elements: from image to image, channel, row, column


class Reading(NamedTuple):
    """Eq. 1-2: stored values to gradients."""

    scale: Real  # factor of stored values
    weights: Floats  # (channels,): of the average that is described, or ones
    averaged: bool  # whether channels are averaged, not compared by magnitude
    channels: int  # that are described: 1 if they are averaged
    sqrt: bool
    sobel: bool
    border_factor: Real  # of the difference to a value beyond the image; 0 for a mirrored image
    border_is_own: bool  # whether that value is the outermost pixel's own
    border_value: Real  # the value, if not
    last_wins: Flags  # (width,): of channels of equal magnitude, the last counts instead of the first


class Voting(NamedTuple):
    """Eq. 2-4: gradients to votes."""

    kind: int  # LINEAR … BEGUN
    hard: bool
    library_angle: bool  # whether votes are by an approximate angle; derivatives are by the exact one
    tiny: Real  # squared magnitudes below vote zero
    up: Real  # -1 if bins go clockwise
    bins_per_half_turn: Real
    offset: Real  # in bins
    turn: Real  # bins, as a real number
    per_bin: Real  # 1 / turn
    slope: Real  # bins per radian; 0 for hard votes, which do not change with the angle
    signed: bool
    directions: Floats  # (2 · axes,): cosines, then sines
    starts: Floats  # (3 · bins,): cosines and sines of where bins begin, and whether in the first half turn
    before: int  # the bin before the first start
    opencv: Floats  # (7,) float32
    vlfeat: Floats  # (2 · axes,) float32
    arccosine: Floats  # (2,) float64: the least magnitude, radians between two axes
    bins: int


class Pooling(NamedTuple):
    """Eq. 5-6: votes to cells.

    A *band* is rows of pixels that vote into the same rows of cells; a *run* is columns that vote into the same columns
    of cells.  The number of cells of either is one or even.
    """

    bands: Integers  # (bands, 3): first row of pixels, the one after the last, first row of cells
    band_of: Integers  # (height,): -1 for rows that do not vote
    most_rows: int  # of pixels, of the largest band
    by_row: Floats  # (height · high,): weights of a row of pixels
    runs: Integers  # (runs, 3): first column of pixels, the one after the last, first column of cells
    by_col: Floats  # (runs · wide · length + padding,): weights of a run's columns for each cell, zero behind them
    parts: Integers  # (parts, 2): first run, the one after the last, of at most 128 columns or one run
    length: int  # columns of the longest run, rounded up to whole eights
    columns: int  # of the widest part
    high: int  # rows of cells of a band
    wide: int  # columns of cells of a run
    lanes: int  # columns that votes are summed up for at a time
    look_up: bool  # whether the gradients of a run's votes fit the tables of :mod:`.pooling_vjp_avx512`
    column_size: int  # numbers of a column of a band: the bins of its rows of cells, padded to whole eights
    bins: int
    rows: int
    cols: int


class Plan(NamedTuple):
    """All that the loops know of a dialect and an image size."""

    reading: Reading
    voting: Voting
    pooling: Pooling


def reading(spec: HOGSpec, channels: int, height: int, width: int, stored: torch.dtype) -> Reading:
    """Of images of that size, stored as uint8 or floating point."""
    real = np.float64 if stored == torch.float64 else np.float32
    averaged = spec.colour == "gray" and channels > 1
    weights = GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels
    border = BORDERS[spec.border]
    return Reading(
        scale=real(spec.value_range / 255 if stored == torch.uint8 else spec.value_range),
        weights=np.array(weights if averaged else (1.0,) * channels, real),
        averaged=averaged,
        channels=1 if averaged else channels,
        sqrt=spec.gamma == "sqrt",
        sobel=MASKS[spec.mask].smooths,
        border_factor=real(border.times),
        border_is_own=border.beyond is None,
        border_value=real((border.beyond or 0) * spec.value_range),
        last_wins=last_of_equals(spec, height, width),
    )


def voting(spec: HOGSpec, real: type[Real]) -> Voting:
    """In float32 or float64, ``real``."""
    rule = vote_rule(spec)
    assert rule.loop is not None  # see :func:`.supports`
    starts, first = beginnings(spec)
    tiny, up = vanishing(torch.float32 if real is np.float32 else torch.float64), -1 if spec.counterclockwise else 1
    return Voting(
        kind=_KINDS[rule.loop],
        hard=rule.hard,
        library_angle=rule.inexact,
        tiny=real(tiny),
        up=real(up),
        bins_per_half_turn=real(spec.bins / 2 if spec.signed else spec.bins),  # exact: right angles are kinks
        offset=real(spec.bin_offset),
        turn=real(spec.bins),
        per_bin=real(1 / spec.bins),
        slope=real(0 if rule.hard else up * spec.bins / spec.period),
        signed=spec.signed,
        directions=hard_directions(spec).astype(real).reshape(-1),
        starts=np.array(starts, real).T.reshape(-1),
        before=spec.bins - 1 + first,
        opencv=np.array(library_angles.opencv_table(spec), np.float32),
        vlfeat=library_angles.vlfeat_directions(spec).reshape(-1),
        arccosine=np.array([library_angles.VLFEAT_LEAST, math.pi / (spec.bins // 2 if spec.signed else spec.bins)]),
        bins=spec.bins,
    )


def _stretches(matrix: npt.NDArray[Any], most: int) -> list[tuple[int, int, int]]:
    """Bands or runs of a matrix (cells, pixels): the first pixel, the one after the last, the first cell.

    Neighbouring pixels are in one as long as they vote into the same ``most`` neighbouring cells.
    """
    voting = np.flatnonzero(matrix.any(axis=0))
    first = (matrix != 0).argmax(axis=0)
    last = len(matrix) - 1 - (matrix[::-1] != 0).argmax(axis=0)
    stretches: list[tuple[int, int, int]] = []
    for pixel in voting:
        if stretches and last[pixel] < stretches[-1][2] + most and first[pixel] >= stretches[-1][2]:
            stretches[-1] = (stretches[-1][0], int(pixel) + 1, stretches[-1][2])
        else:
            stretches.append((int(pixel), int(pixel) + 1, int(first[pixel])))
    return stretches


def _extent(matrix: npt.NDArray[Any]) -> int:
    """The largest number of neighbouring cells that a pixel votes into."""
    votes = (matrix != 0)[:, matrix.any(axis=0)]
    last = len(votes) - votes[::-1].argmax(axis=0)
    return int((last - votes.argmax(axis=0)).max(initial=1))


def _one_or_even(count: int) -> int:
    return 1 if count == 1 else -(-count // 2) * 2


def _weights(
    matrix: npt.NDArray[Any], stretches: list[tuple[int, int, int]], most: int
) -> Iterator[tuple[int, npt.NDArray[Any]]]:
    """The first pixel of each stretch, and the weights of its pixels for ``most`` cells."""
    for start, stop, first in stretches:
        weights = np.zeros((stop - start, most), matrix.dtype)
        cells = matrix[first : first + most, start:stop]
        weights[:, : len(cells)] = cells.T
        yield start, weights


def _without_gaps(runs: list[tuple[int, int, int]], width: int) -> list[tuple[int, int, int]]:
    """Runs extended to all columns: those added vote with weight zero."""
    if not runs:
        return []
    starts = [0, *(start for start, _, _ in runs[1:])]
    return [(start, stop, first) for start, stop, (_, _, first) in zip(starts, [*starts[1:], width], runs, strict=True)]


def _parts(runs: list[tuple[int, int, int]]) -> npt.NDArray[np.int64]:
    """Neighbouring runs joined, up to 128 columns: a part is pooled at a time."""
    parts: list[tuple[int, int]] = []
    for k, (_, stop, _) in enumerate(runs):
        if parts and stop - runs[parts[-1][0]][0] <= _COLUMNS:
            parts[-1] = (parts[-1][0], k + 1)
        else:
            parts.append((k, k + 1))
    return np.array(parts, np.int64).reshape(-1, 2)


@lru_cache(maxsize=64)
def pooling(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> Pooling:
    """Of images of that size."""
    matrices = pooling_matrices(spec, height, width, torch.empty(0, dtype=dtype))
    of_rows, of_cols = (matrix.numpy() for matrix in matrices)
    high, wide = (_one_or_even(_extent(matrix)) for matrix in (of_rows, of_cols))
    bands, runs = _stretches(of_rows, high), _without_gaps(_stretches(of_cols, wide), width)
    by_row, band_of = np.zeros((height, high), of_rows.dtype), np.full(height, -1, np.int64)
    for k, (start, weights) in enumerate(_weights(of_rows, bands, high)):
        by_row[start : start + len(weights)] = weights
        band_of[start : start + len(weights)] = k
    length = -(-max((stop - start for start, stop, _ in runs), default=0) // 8) * 8
    by_col = np.zeros((len(runs), wide, length), of_cols.dtype)
    for of_run, (_, weights) in zip(by_col, _weights(of_cols, runs, wide), strict=True):
        of_run[:, : len(weights)] = weights.T
    parts = _parts(runs)
    return Pooling(
        bands=np.array(bands, np.int64).reshape(-1, 3),
        band_of=band_of,
        most_rows=max((stop - start for start, stop, _ in bands), default=1),
        by_row=by_row.reshape(-1),
        runs=np.array(runs, np.int64).reshape(-1, 3),
        by_col=np.append(by_col, np.zeros(PADDING, by_col.dtype)),
        parts=parts,
        length=length,
        columns=max((runs[last - 1][1] - runs[first][0] for first, last in parts), default=0),
        high=high,
        wide=wide,
        lanes=lanes(by_row.itemsize),
        look_up=high == wide == 2 and fits(by_row.itemsize, spec.bins),
        column_size=-(-high * spec.bins // 8) * 8,
        bins=spec.bins,
        rows=len(of_rows),
        cols=len(of_cols),
    )
