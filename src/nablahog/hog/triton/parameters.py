"""What the kernels know of a dialect and an image size: constants that are compiled in, and tables.

Kernels are compiled once for a dialect, number of channels and dtype; image sizes are arguments.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ..gradient import BORDERS, channel_weights, last_of_equals
from ..orientation import beginnings, opencv_table, vote_directions, vote_rule
from ..spec import HOGSpec
from ..steps import PixelCells, pixel_cells

_MOST_REGISTERS = 160  # of a thread, for sums
_COLUMNS = (8, 6, 4, 3, 2, 1)  # that a lane may read at a time


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
    exact: bool  # whether votes are linear, by the angle of Eq. 2
    inexact: bool  # whether votes are by an approximate angle; derivatives are by the exact one
    counterclockwise: bool
    signed: bool
    bins: int
    axes: int  # bin directions that are compared, if opposite ones are one
    bins_per_half_turn: float
    offset: float  # in bins, at most half a turn
    diagonals: bool  # whether one of them may be the centre of a bin
    lowest: int  # bin of a linear vote, before it is taken modulo the number of bins
    highest: int
    slope: float  # bins per radian
    before: int  # the bin before the first beginning
    opencv: tuple[float, ...]
    between_axes: float  # radians
    table: tuple[float, ...]  # directions of bins, or where bins begin, for the rules that search among them


def reading(spec: HOGSpec, channels: int, stored: torch.dtype) -> Reading:
    """How to read images with ``channels`` channels, bytes or floats; not ``wide``."""
    averaged, weights = channel_weights(spec, channels)
    border = BORDERS[spec.border]
    return Reading(
        scale=spec.value_range / 255 if stored == torch.uint8 else float(spec.value_range),
        weights=weights,
        averaged=averaged,
        stored=channels,
        channels=1 if averaged else channels,
        sqrt=spec.gamma == "sqrt",
        sobel=spec.mask == "sobel",
        border_factor=float(border.times),
        border_is_own=border.beyond is None,
        border_value=float((border.beyond or 0) * spec.value_range),
        wide=False,
    )


def voting(spec: HOGSpec) -> Voting:
    """The dialect's."""
    rule = vote_rule(spec)
    axes = spec.bins // 2 if spec.signed else spec.bins
    bins_per_half_turn = spec.bins / 2 if spec.signed else float(spec.bins)
    offset = float(spec.bin_offset if 2 * spec.bin_offset <= spec.bins else spec.bin_offset - spec.bins)
    return Voting(
        hard=rule.hard,
        exact=rule.name == "linear",
        inexact=rule.inexact,
        counterclockwise=spec.counterclockwise,
        signed=spec.signed,
        bins=spec.bins,
        axes=axes,
        bins_per_half_turn=bins_per_half_turn,
        offset=offset,
        diagonals=any((k / 4 * bins_per_half_turn - offset) % 1 == 0 for k in (-3, -1, 1, 3)),
        lowest=math.floor(-spec.bins / 2 - offset),
        highest=math.ceil(spec.bins / 2 - offset),
        slope=(-1 if spec.counterclockwise else 1) * spec.bins / spec.period,
        before=spec.bins - 1 + beginnings(spec)[1],
        opencv=opencv_table(spec),
        between_axes=math.pi / axes,
        table=tuple(map(float, vote_directions(spec).reshape(-1))),
    )


class Bands(NamedTuple):
    """Eq. 5-6 along one axis: runs of pixels; a band votes into the cells from ``band - reach + 1`` to ``band``."""

    reach: int
    longest: int  # pixels of a band
    first: Tensor  # (bands,) int32: the first pixel, or one before it
    weights: Tensor  # (longest, reach, bands): of the pixels from there on in these cells; 0 outside of the band


class Gather(NamedTuple):
    """Eq. 5-6 along one axis: the cells that each pixel votes into."""

    first: Tensor  # (pixels,) int32
    reach: int
    weights: Tensor  # (pixels, reach): in the cells from the first on


class AxisTables(NamedTuple):
    """Eq. 5-6 along one axis."""

    cells: int
    bands: Bands
    gather: Gather
    voting: tuple[int, int]  # the first pixel of all bands, and the one after the last


def _pixels_of_cells(along: PixelCells) -> npt.NDArray[np.int64]:
    """(cells, 2): the first pixel that votes into each cell, and the one after the last; 0 and 0 if there is none."""
    cells = along.first[:, np.newaxis] + np.arange(along.reach)
    pixel, k = along.weights(np.arange(len(cells))[:, np.newaxis], cells).nonzero()
    first, stop = np.full(along.cells, len(cells)), np.zeros(along.cells, np.int64)
    np.minimum.at(first, cells[pixel, k], pixel)
    np.maximum.at(stop, cells[pixel, k], pixel + 1)
    return np.stack([np.minimum(first, stop), stop], axis=1)


def _limits(along: PixelCells, reach: int, longest: int) -> list[list[int]] | None:
    """First pixel, and the one after the last, of bands of limited length; None if they would be longer."""
    first, stop = along.first.tolist(), along.stop.tolist()
    bands = [[0, 0] for _ in range(along.cells + reach - 1)]
    band = 0
    for pixel in along.voting.tolist():
        band = max(band, stop[pixel] - 1)
        if bands[band][1] and pixel - bands[band][0] >= longest:
            band += 1
        if band > first[pixel] + reach - 1:
            return None
        if not bands[band][1]:
            bands[band][0] = pixel
        bands[band][1] = pixel + 1
    return bands


def _bands(along: PixelCells, reach: int, at_once: tuple[int, ...], device: torch.device) -> Bands:
    """The shortest; with a reach of 1 they may overlap, each all pixels of a cell.

    They are as long as a multiple of one of the numbers ``at_once``.
    """
    pixels = len(along.first)
    if reach < along.reach:
        limits = _pixels_of_cells(along)
    else:
        least = bisect_left(range(1, pixels + 1), True, key=lambda n: _limits(along, reach, n) is not None) + 1
        limits = np.array(_limits(along, reach, least))
    start, stop = limits.T
    longest = max(int((stop - start).max()), 1)
    # one column more is read on either side
    count = min(at_once, key=lambda n: -(-longest // n) * (n + 1))
    longest = -(-longest // count) * count
    first = np.maximum(np.minimum(start, pixels - longest), 0)  # so that all of them are in the image, if there is room
    pixel = first + np.arange(longest)[:, np.newaxis]
    inside = (pixel >= start) & (pixel < stop)
    own = np.arange(len(limits)) + np.arange(1 - reach, 1)[:, np.newaxis]
    weights = along.weights(np.where(inside, pixel, 0)[:, np.newaxis], own)
    weights = np.where(inside[:, np.newaxis], weights, 0)
    return Bands(reach, longest, _tensor(first.astype(np.int32), device), _tensor(weights, device))


def columns_at_once(bands: Bands, registers: int) -> int:
    """Columns of its band that a lane reads at once, if a pixel takes ``registers`` registers."""
    most = 8 if registers == 1 else 4
    return next(n for n in _COLUMNS if n <= most and bands.longest % n == 0)


def _gather(along: PixelCells, device: torch.device) -> Gather:
    first = np.minimum(along.first, along.cells - along.reach)  # all of them are cells
    weights = along.weights(np.arange(len(first))[:, np.newaxis], first[:, np.newaxis] + np.arange(along.reach))
    return Gather(_tensor(first.astype(np.int32), device), along.reach, _tensor(weights, device))


def _tensor(array: npt.NDArray[Any], device: torch.device) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array)).to(device)


def _axis(along: PixelCells, reach: int, at_once: tuple[int, ...], device: torch.device) -> AxisTables:
    voting = along.voting
    span = (int(voting[0]), int(voting[-1]) + 1) if len(voting) else (0, 0)
    return AxisTables(along.cells, _bands(along, reach, at_once, device), _gather(along, device), span)


class KernelTables(NamedTuple):
    """All that the kernels over pixels know of a dialect and an image size."""

    reading: Reading
    voting: Voting
    rule: str  # the vote rule's name
    rows: AxisTables
    cols: AxisTables
    last_wins: tuple[int, int]  # columns, first and after the last, where of equal channels the last counts


@lru_cache(maxsize=64)
def make_tables(
    spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype, device: torch.device
) -> KernelTables:
    """The tables for images (…, channels, height, width), computed in ``real``, float32 or float64."""
    channels, height, width = shape[-3:]
    spec.grid(height, width)  # raises if it is too small
    down, across = pixel_cells(spec, height, width, real)
    high, wide = down.reach, across.reach
    # all cells that a pixel votes into, at once if their sums fit into registers; otherwise pixels are read again
    numbers = _MOST_REGISTERS // (real.itemsize // 4) // spec.bins
    high = high if high * wide <= numbers else 1
    wide = wide if high * wide <= numbers else 1
    last = np.flatnonzero(last_of_equals(spec, height, width))
    return KernelTables(
        reading=reading(spec, channels, stored),
        voting=voting(spec),
        rule=vote_rule(spec).name,
        rows=_axis(down, high, (1,), device),
        cols=_axis(across, wide, _COLUMNS, device),
        last_wins=(int(last[0]), int(last[-1]) + 1) if len(last) else (0, 0),
    )
