"""What the kernels know of a dialect and an image size: constants that are compiled in, and tables.

Kernels are compiled once for a dialect, number of channels and dtype; image sizes are arguments.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from .. import library_angles
from ..gradient import BORDERS, GRAY_WEIGHTS, MASKS, last_of_equals
from ..orientation import beginnings, hard_directions, vote_rule
from ..pooling import pooling_matrices
from ..spec import HOGSpec

_TILE = 1024  # pixels that a program reads at a time
_MOST_ROWS = 32  # of them
_MOST_CELLS = 16  # that a program owns: their weights are in registers


class Reading(NamedTuple):
    """Eq. 1-2: stored values to gradients."""

    scale: float  # factor of stored values
    weights: tuple[float, ...]  # of the average of channels that is described, or ones
    averaged: bool  # whether channels are averaged, not compared by magnitude
    stored: int  # channels of an image
    channels: int  # that are described: 1 if they are averaged
    sqrt: bool
    sobel: bool
    border_factor: float  # of the difference to a value beyond the image; 0 for a mirrored image
    border_is_own: bool  # whether that value is the outermost pixel's own
    border_value: float  # the value, if not
    wide: bool  # whether places of an image's pixels in memory take more than 32 bits


class Voting(NamedTuple):
    """Eq. 2-4: gradients to votes."""

    hard: bool
    inexact: bool  # whether votes are by an approximate angle; derivatives are by the exact one
    counterclockwise: bool
    signed: bool
    bins: int
    axes: int  # bin directions that are compared, if opposite ones are one
    bins_per_half_turn: float
    offset: float  # in bins
    slope: float  # bins per radian
    before: int  # the bin before the first beginning
    opencv: tuple[float, ...]
    between_axes: float  # radians


def reading(spec: HOGSpec, channels: int, stored: torch.dtype) -> Reading:
    """Of images of so many channels, stored as bytes or floats; one where colours are separate; not ``wide``."""
    averaged = spec.colour == "gray" and channels > 1
    channels = 1 if spec.colour == "separate" else channels
    weights = GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels
    border = BORDERS[spec.border]
    return Reading(
        scale=spec.value_range / 255 if stored == torch.uint8 else float(spec.value_range),
        weights=tuple(weights) if averaged else (1.0,) * channels,
        averaged=averaged,
        stored=channels,
        channels=1 if averaged else channels,
        sqrt=spec.gamma == "sqrt",
        sobel=MASKS[spec.mask].smooths,
        border_factor=float(border.times),
        border_is_own=border.beyond is None,
        border_value=float((border.beyond or 0) * spec.value_range),
        wide=False,
    )


def voting(spec: HOGSpec) -> Voting:
    """The dialect's."""
    rule = vote_rule(spec)
    axes = spec.bins // 2 if spec.signed else spec.bins
    return Voting(
        hard=rule.hard,
        inexact=rule.inexact,
        counterclockwise=spec.counterclockwise,
        signed=spec.signed,
        bins=spec.bins,
        axes=axes,
        bins_per_half_turn=spec.bins / 2 if spec.signed else float(spec.bins),
        offset=float(spec.bin_offset),
        slope=(-1 if spec.counterclockwise else 1) * spec.bins / spec.period,
        before=spec.bins - 1 + beginnings(spec)[1],
        opencv=library_angles.opencv_table(spec),
        between_axes=math.pi / axes,
    )


def vote_table(spec: HOGSpec) -> npt.NDArray[np.float64]:
    """Directions of bins, or where bins begin, for the rules that search among them."""
    rule = vote_rule(spec).loop
    if rule == "nearest":
        return hard_directions(spec).astype(np.float64).reshape(-1)
    if rule == "vlfeat":
        return library_angles.vlfeat_directions(spec).astype(np.float64).reshape(-1)
    starts: npt.NDArray[np.float64] = np.array(beginnings(spec)[0], np.float64).T.reshape(-1)
    return starts


class Axis(NamedTuple):
    """Eq. 5-6 along one axis: the weights of pixels in cells, from either side."""

    cells: int
    chunks: int  # of neighbouring cells, each the work of one program
    of_chunk: int  # cells in it
    tile: int  # pixels that a program reads at a time, a power of two
    steps: int  # how many times
    spans: Tensor  # (chunks, 2) int32: the first pixel that votes into a chunk, and the one after the last
    first: Tensor  # (cells,) int32: the first pixel that votes into a cell
    length: int
    weights: Tensor  # (cells, length): of the pixels from there on
    first_cell: Tensor  # (pixels,) int32: that a pixel votes into
    reach: int
    cell_weights: Tensor  # (pixels, reach): in the cells from there on


def _extents(matrix: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Of each row, the first entry that is not 0 and the one after the last; 0 and 0 if there is none."""
    some = matrix != 0
    first, last = some.argmax(axis=1), some.shape[1] - some[:, ::-1].argmax(axis=1)
    return np.where(some.any(axis=1), first, 0), np.where(some.any(axis=1), last, 0)


def _windows(matrix: npt.NDArray[Any], first: npt.NDArray[np.int64], length: int) -> npt.NDArray[Any]:
    """Of each row, ``length`` entries from the first on; 0 beyond the end."""
    places = first[:, None] + np.arange(length)
    entries: npt.NDArray[Any] = np.take_along_axis(matrix, np.minimum(places, matrix.shape[1] - 1), axis=1)
    return np.where(places < matrix.shape[1], entries, 0)


def power_of_two(count: int) -> int:
    """The smallest that is not below the count."""
    return 1 << max(count - 1, 0).bit_length()


def _spans(first: npt.NDArray[np.int64], last: npt.NDArray[np.int64], of_chunk: int) -> npt.NDArray[np.int32]:
    """Of each chunk of so many cells, the first pixel that votes into it and the one after the last."""
    spans = np.zeros((-(-len(first) // of_chunk), 2), np.int32)
    for k in range(len(spans)):
        own = slice(k * of_chunk, (k + 1) * of_chunk)
        used = last[own] > first[own]
        if used.any():
            spans[k] = first[own][used].min(), last[own].max()
    return spans


def _axis(matrix: npt.NDArray[Any], most_pixels: int, most_cells: int, device: torch.device) -> Axis:
    """Of a matrix (cells, pixels): chunks of at most so many cells, tiles of at most so many pixels, a power of two."""
    first, last = _extents(matrix)
    length = max(int((last - first).max()), 1)

    def read(of_chunk: int) -> tuple[int, int]:  # pixels a chunk, and those of whole tiles
        spans = _spans(first, last, of_chunk)
        most = max(int((spans[:, 1] - spans[:, 0]).max()), 1)
        return most, power_of_two(most)

    # a tile is a power of two: the most cells for its pixels, of chunks that fit
    choices = range(1, min(most_cells, len(matrix)) + 1)
    of_chunk = max(choices, key=lambda n: (read(n)[1] <= most_pixels, n / read(n)[1], n))
    most, whole = read(of_chunk)
    if whole > most_pixels:  # not even one cell fits
        of_chunk = 1
        most, whole = read(1)
    spans, tile = _spans(first, last, of_chunk), min(whole, most_pixels)
    first_cell, last_cell = _extents(matrix.T)
    reach = max(int((last_cell - first_cell).max()), 1)

    def table(array: npt.NDArray[Any]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device)

    return Axis(
        cells=len(matrix),
        chunks=len(spans),
        of_chunk=of_chunk,
        tile=tile,
        steps=-(-most // tile),
        spans=table(spans),
        first=table(first.astype(np.int32)),
        length=length,
        weights=table(_windows(matrix, first, length)),
        first_cell=table(first_cell.astype(np.int32)),
        reach=reach,
        cell_weights=table(_windows(matrix.T, first_cell, reach)),
    )


class Plan(NamedTuple):
    """All that the kernels over pixels know of a dialect and an image size."""

    reading: Reading
    voting: Voting
    rule: str  # the vote rule's name
    table: Tensor  # of it
    rows: Axis
    cols: Axis
    last_wins: tuple[int, int]  # columns, first and after the last, where of equal channels the last counts


@lru_cache(maxsize=64)
def plan(spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype, device: torch.device) -> Plan:
    """Of images (…, channels, height, width), computed in float32 or float64, ``real``."""
    channels, height, width = shape[-3:]
    spec.grid(height, width)  # raises if it is too small
    of_rows, of_cols = (m.numpy() for m in pooling_matrices(spec, height, width, torch.empty(0, dtype=real)))
    rows = _axis(of_rows, _MOST_ROWS, 1, device)
    last = np.flatnonzero(last_of_equals(spec, height, width))
    rule = vote_rule(spec).loop
    assert rule is not None  # see :func:`.supports`
    return Plan(
        reading=reading(spec, channels, stored),
        voting=voting(spec),
        rule=rule,
        table=torch.from_numpy(vote_table(spec)).to(device, real),
        rows=rows,
        cols=_axis(of_cols, _TILE // rows.tile, _MOST_CELLS, device),
        last_wins=(int(last[0]), int(last[-1]) + 1) if len(last) else (0, 0),
    )
