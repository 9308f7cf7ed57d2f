"""What the compiled loops need to know of a dialect and a size of image: numbers and tables, made once for each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from ...runtime.simd import PADDING, lanes
from .. import library_angles
from ..gradient import BORDERS, GRAY_WEIGHTS, MASKS, last_of_equals
from ..orientation import beginnings, hard_directions, vanishing, vote_rule
from ..pooling import pooling_matrices
from ..spec import HOGSpec
from .pooling_vjp_avx512 import fits

LINEAR, OPENCV, VLFEAT, NEAREST, BEGUN = range(5)  # the ways to vote
_KINDS = {"linear": LINEAR, "opencv": OPENCV, "vlfeat": VLFEAT, "nearest": NEAREST, "begun": BEGUN}
_COLUMNS = 128  # that are summed up together: their sums stay in a processor's first cache


class Reading(NamedTuple):
    """From stored values to gradients: Eq. 1-2."""

    scale: Any  # of stored values
    weights: Any  # (channels,) of the mean that is described, or ones
    mixed: bool  # whether that mean is, not the channel of largest gradient
    root: bool
    sobel: bool
    times: Any  # how often the difference to a value beyond the image counts: 0 for a mirrored image
    own: bool  # whether that value is the outermost pixel's own
    beyond: Any  # the value, if not
    last_wins: Any  # (width,): of channels of equal gradients, the last counts instead of the first


class Voting(NamedTuple):
    """From gradients to votes: Eq. 2-4."""

    kind: int  # one of LINEAR … BEGUN
    hard: bool
    inexact: bool  # whether the derivative is by another angle than the votes
    numbers: Any  # (6,): tiny, up, per_half_turn, offset, count, and one by count
    tiny: Any
    up: Any  # -1 if bins go against the clock
    per_half_turn: Any  # bins
    offset: Any
    count: Any  # bins
    slope: Any  # bins per radian; 0 if votes know the magnitude only
    signed: bool
    directions: Any  # (2 · axes,)
    starts: Any  # (3 · bins,)
    before: int  # the bin before the first start
    opencv: Any  # (7,) float32
    vlfeat: Any  # (2 · axes,) float32
    arccosine: Any  # (2,) float64: the least magnitude, radians between two axes
    bins: int


class Pooling(NamedTuple):
    """From votes to cells: Eq. 5-6.

    Rows of pixels that share their cells are a band, columns that do are a run.  Of either, the number of cells is even
    or one.
    """

    bands: Any  # (bands, 3): first row of pixels, the one after the last, first row of cells
    band_of: Any  # (height,): -1 for rows that do not vote
    by_row: Any  # (height · high,): weights of a row of pixels
    runs: Any  # (runs, 3): first column of pixels, the one after the last, first column of cells
    by_col: Any  # (runs · wide · length + padding,): weights of a run's columns for each of its cells, zero behind them
    parts: Any  # (parts, 2): first run, the one after the last, of few enough columns for a processor's first cache
    length: int  # columns of a run, rounded up to whole eights
    columns: int  # of a part
    high: int  # rows of cells of a band
    wide: int  # columns of cells of a run
    at_once: int  # columns
    looked_up: bool  # whether what reaches a run's votes fits the tables of :mod:`.pooling_vjp_avx512`
    of_cell: int  # numbers of a column of a band: the bins of its rows of cells, padded to whole eights
    bins: int
    rows: int
    cols: int


def reading(spec: HOGSpec, channels: int, height: int, width: int, stored: torch.dtype) -> Reading:
    """Of images with so many channels and of that size, stored as uint8 or as floating point."""
    real = np.float64 if stored == torch.float64 else np.float32
    mixed = spec.colour == "gray" and channels > 1
    weights = GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels
    last = last_of_equals(spec, height, width)
    border = BORDERS[spec.border]
    return Reading(
        scale=real(spec.value_range / 255 if stored == torch.uint8 else spec.value_range),
        weights=np.array(weights if mixed else (1.0,) * channels, real),
        mixed=mixed,
        root=spec.gamma == "sqrt",
        sobel=MASKS[spec.mask].smooths,
        times=real(border.times),
        own=border.beyond is None,
        beyond=real((border.beyond or 0) * spec.value_range),
        last_wins=last,
    )


def voting(spec: HOGSpec, real: Any) -> Voting:
    """In float32 or float64, ``real``."""
    rule = vote_rule(spec)
    assert rule.loop is not None  # see :func:`.supports`
    starts, first = beginnings(spec)
    tiny, up = vanishing(torch.float32 if real is np.float32 else torch.float64), -1 if spec.counterclockwise else 1
    per_half_turn = spec.bins * math.pi / spec.period
    return Voting(
        kind=_KINDS[rule.loop],
        hard=rule.hard,
        inexact=rule.inexact,
        numbers=np.array([tiny, up, per_half_turn, spec.bin_offset, spec.bins, 1 / spec.bins], real),
        tiny=real(tiny),
        up=real(up),
        per_half_turn=real(per_half_turn),
        offset=real(spec.bin_offset),
        count=real(spec.bins),
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
    """Pixels in a row whose cells are among ``most`` in a row: the first, the one after the last, the first cell."""
    voting = np.flatnonzero(matrix.any(axis=0))
    first = (matrix != 0).argmax(axis=0)
    last = len(matrix) - 1 - (matrix[::-1] != 0).argmax(axis=0)
    found: list[tuple[int, int, int]] = []
    for pixel in voting:
        if found and last[pixel] < found[-1][2] + most and first[pixel] >= found[-1][2]:
            found[-1] = (found[-1][0], int(pixel) + 1, found[-1][2])
        else:
            found.append((int(pixel), int(pixel) + 1, int(first[pixel])))
    return found


def _extent(matrix: npt.NDArray[Any]) -> int:
    """How many cells in a row a pixel votes into, at most."""
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
        found = np.zeros((stop - start, most), matrix.dtype)
        cells = matrix[first : first + most, start:stop]
        found[:, : len(cells)] = cells.T
        yield start, found


def _to_each_other(runs: list[tuple[int, int, int]], width: int) -> list[tuple[int, int, int]]:
    """The same with all columns in one of them: others vote with a weight of zero."""
    if not runs:
        return []
    starts = [0, *(start for start, _, _ in runs[1:])]
    return [(start, stop, first) for start, stop, (_, _, first) in zip(starts, [*starts[1:], width], runs, strict=True)]


def _parts(runs: list[tuple[int, int, int]]) -> npt.NDArray[np.int64]:
    """Runs of few columns together, as many as possible."""
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
    bands, runs = _stretches(of_rows, high), _to_each_other(_stretches(of_cols, wide), width)
    by_row = np.zeros((height, high), of_rows.dtype)
    for start, weights in _weights(of_rows, bands, high):
        by_row[start : start + len(weights)] = weights
    length = -(-max((stop - start for start, stop, _ in runs), default=0) // 8) * 8
    by_col = np.zeros((len(runs), wide, length), of_cols.dtype)
    for of_run, (_, weights) in zip(by_col, _weights(of_cols, runs, wide), strict=True):
        of_run[:, : len(weights)] = weights.T
    parts = _parts(runs)
    band_of = np.full(height, -1, np.int64)
    for k, (start, stop, _) in enumerate(bands):
        band_of[start:stop] = k
    return Pooling(
        bands=np.array(bands, np.int64).reshape(-1, 3),
        band_of=band_of,
        by_row=by_row.reshape(-1),
        runs=np.array(runs, np.int64).reshape(-1, 3),
        by_col=np.append(by_col, np.zeros(PADDING, by_col.dtype)),
        parts=parts,
        length=length,
        columns=max((runs[last - 1][1] - runs[first][0] for first, last in parts), default=0),
        high=high,
        wide=wide,
        at_once=lanes(by_row.itemsize),
        looked_up=high == wide == 2 and fits(by_row.itemsize, spec.bins),
        of_cell=-(-high * spec.bins // 8) * 8,
        bins=spec.bins,
        rows=len(of_rows),
        cols=len(of_cols),
    )
