"""What the compiled loops need to know of a dialect and a size of image: numbers and tables, made once for each."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from .. import angles
from ..gradient import GRAY_WEIGHTS, MIDDLE, last_of_equals
from ..orientation import beginnings, hard_directions, vanishing
from ..pooling import pooling_matrices
from ..spec import HOGSpec

LINEAR, OPENCV, VLFEAT, NEAREST, BEGUN = range(5)  # the ways to vote
_CACHED_BYTES = 2**14  # of a processor's cache that groups may take while pixels go to and fro
_BESIDE = 3  # bins that a group has beside its own: one before, two after


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
    tiny: Any
    up: Any  # -1 if bins go against the clock
    per_half_turn: Any  # bins
    offset: Any
    count: Any  # bins
    slope: Any  # bins per radian; 0 if votes know the magnitude only
    signed: bool
    directions: Any  # (2, axes)
    starts: Any  # (3, bins)
    first: int
    opencv: Any  # (7,) float32
    vlfeat: Any  # (2, axes) float32


class Pooling(NamedTuple):
    """From votes to cells: Eq. 5-6.

    Rows of pixels that share their cells are a band, columns that do are a run.  The lanes of :mod:`.lanes` are the two
    rows of two cells where a band and a run meet.  If a pixel votes into more, they are four columns, or ``groups``
    times as many, whose rows are shared out for a whole line of pixels at a time.
    """

    bands: Any  # (bands, 3): first row of pixels, the one after the last, first row of cells
    band_of: Any  # (height,): -1 for rows that do not vote
    by_row: Any  # (height · 4,) of the lanes
    shares: Any  # (height, high) of whole lines
    by_col: Any  # (width · groups · 4,)
    order: Any  # columns of pixels, neighbours apart: what one adds must have arrived before another adds to it
    parts: Any  # (parts, 4) that stay in a processor's cache: begin and end in ``order``, begin and end of their groups
    base: Any  # (width,): where the groups of a column's run begin
    run_cols: Any  # (runs,): first column of cells
    lines: bool  # whether the lanes are columns only
    high: int  # rows of cells of a band
    wide: int  # columns of cells of a run
    groups: int
    group: int  # numbers in one
    bins: int
    rows: int
    cols: int


def reading(spec: HOGSpec, channels: int, height: int, width: int, stored: torch.dtype) -> Reading:
    """Of images with so many channels and of that size, stored as uint8 or as floating point."""
    real = np.float64 if stored == torch.float64 else np.float32
    mixed = spec.colour == "gray" and channels > 1
    weights = GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels
    last = last_of_equals(spec, height, width)
    times, own = {"replicate": (1, True), "extrapolate": (2, True), "zero": (1, False), "gray": (1, False)}.get(
        spec.border, (0, True)
    )
    return Reading(
        scale=real(spec.value_range / 255 if stored == torch.uint8 else spec.value_range),
        weights=np.array(weights if mixed else (1.0,) * channels, real),
        mixed=mixed,
        root=spec.gamma == "sqrt",
        sobel=spec.mask == "sobel",
        times=real(times),
        own=own,
        beyond=real(MIDDLE * spec.value_range if spec.border == "gray" else 0),
        last_wins=last,
    )


def voting(spec: HOGSpec, real: Any) -> Voting:
    """In float32 or float64, ``real``."""
    linear = {"exact": LINEAR, "opencv": OPENCV, "vlfeat": VLFEAT}[spec.angle]
    hard = spec.vote == "hard"
    starts, first = beginnings(spec)
    return Voting(
        kind=(NEAREST if spec.boundary == "first" else BEGUN) if hard else linear,
        hard=hard,
        inexact=not hard and spec.angle == "vlfeat",
        tiny=real(vanishing(torch.float32 if real is np.float32 else torch.float64)),
        up=real(-1 if spec.counterclockwise else 1),
        per_half_turn=real(spec.bins * math.pi / spec.period),
        offset=real(spec.bin_offset),
        count=real(spec.bins),
        slope=real(0 if hard else (-1 if spec.counterclockwise else 1) * spec.bins / spec.period),
        signed=spec.signed,
        directions=hard_directions(spec).astype(real),
        starts=np.array(starts, real).T.copy(),
        first=first,
        opencv=np.array(angles.opencv_table(spec), np.float32),
        vlfeat=angles.vlfeat_directions(spec),
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


def _weights(matrix: npt.NDArray[Any], stretches: list[tuple[int, int, int]], most: int) -> npt.NDArray[Any]:
    """(pixels, most) of a matrix (cells, pixels)."""
    found = np.zeros((matrix.shape[1], most), matrix.dtype)
    for start, stop, first in stretches:
        cells = matrix[first : first + most, start:stop]
        found[start:stop, : len(cells)] = cells.T
    return found


def _apart(
    runs: list[tuple[int, int, int]], at_once: int, size: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """The columns of some runs at a time, the first of each, the second of each, and so on; and where these begin.

    The groups of a run are ``size`` numbers.
    """
    order: list[int] = []
    parts = []
    for k in range(0, len(runs), at_once):
        few = runs[k : k + at_once]
        longest = max(stop - start for start, stop, _ in few)
        columns = [start + i for i in range(longest) for start, stop, _ in few if start + i < stop]
        parts.append((len(order), len(order) + len(columns), k * size, (k + len(few)) * size))
        order += columns
    return np.array(order, np.int32), np.array(parts, np.int64).reshape(-1, 4)


@lru_cache(maxsize=64)
def pooling(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> Pooling:
    """Of images of that size."""
    matrices = pooling_matrices(spec, height, width, torch.empty(0, dtype=dtype))
    of_rows, of_cols = (matrix.numpy() for matrix in matrices)
    extents = _extent(of_rows), _extent(of_cols)
    lines = max(extents) > 2
    # a row of cells more than one line votes into makes for fewer bands
    high, wide = (extents[0] + 1, -(-extents[1] // 4) * 4) if lines else (2, 2)
    bands, runs = _stretches(of_rows, high), _stretches(of_cols, wide)
    by_row, by_col = _weights(of_rows, bands, high), _weights(of_cols, runs, wide)
    shares = by_row
    if lines:
        by_row = np.ones((height, 4), shares.dtype)
    else:
        by_row, by_col = by_row[:, [0, 0, 1, 1]], by_col[:, [0, 1, 0, 1]]
    groups = by_col.shape[1] // 4
    group = (spec.bins + _BESIDE) * 4
    base = np.zeros(width, np.int32)
    for k, (start, stop, _) in enumerate(runs):
        base[start:stop] = k * groups * group
    band_of = np.full(height, -1, np.int64)
    for k, (start, stop, _) in enumerate(bands):
        band_of[start:stop] = k
    copies = high + 1 if lines else 1  # of the groups: of a line, and of each row of cells of its band
    at_once = max(4, _CACHED_BYTES // (copies * groups * group * by_row.itemsize))
    order, parts = _apart(runs, at_once, groups * group)
    return Pooling(
        bands=np.array(bands, np.int64).reshape(-1, 3),
        band_of=band_of,
        by_row=np.ascontiguousarray(by_row).reshape(-1),
        shares=shares,
        by_col=np.ascontiguousarray(by_col).reshape(-1),
        order=order,
        parts=parts,
        base=base,
        run_cols=np.array([first for _, _, first in runs], np.int64),
        lines=lines,
        high=high,
        wide=wide,
        groups=groups,
        group=group,
        bins=spec.bins,
        rows=len(of_rows),
        cols=len(of_cols),
    )
