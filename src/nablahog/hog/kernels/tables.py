"""``native/tables.h`` filled in: what the native loops know of a dialect, an image size and a dtype."""

from __future__ import annotations

import ctypes
import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from ... import native
from ..gradient import BLACK, BORDERS, channel_weights, last_of_equals
from ..orientation import VLFEAT_LEAST, beginnings, opencv_table, vanishing, vote_directions, vote_rule
from ..spec import HOGSpec
from ..steps import PixelCells, pixel_cells

PIXEL_CODES = {torch.uint8: 0, torch.float32: 1, torch.float64: 2}
MIRROR, REPEAT, CONSTANT = range(3)
VOTE_CODES = {"linear": 0, "opencv": 1, "vlfeat": 2, "nearest": 3, "begun": 4}
COLUMN_PADDING = 16  # numbers of the widest vector: tables of columns are rounded up to these, and have as many more

_int32, _int64, _double, _pointer = ctypes.c_int32, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p

_has_normalizer = native.function("has_normalizer", ctypes.c_char_p, _pointer)


@cache
def _find_normalizer(kind: str) -> bool:
    found = _int32()
    _has_normalizer(kind.encode(), ctypes.byref(found))
    return bool(found.value)


def has_normalizer(kind: str) -> bool:
    """Whether there are compiled loops, of a kind of normaliser, too."""
    return native.library() is not None and _find_normalizer(kind)


has_normalizer._dynamo_marked_constant = True  # type: ignore[attr-defined]  # as native.available


def _fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class AxisStruct(ctypes.Structure):
    """``nablahog_axis``."""

    _fields_ = [
        *_fields(_int64, "pixels cells extent stretches longest run"),
        *_fields(_pointer, "stretch weights run_weights cell_weights"),
    ]


class TablesStruct(ctypes.Structure):
    """``nablahog_tables``."""

    _fields_ = [
        *_fields(_int64, "channels height width"),
        *_fields(_int32, "pixels averaged square_root sobel border border_doubled"),
        *_fields(_double, "scale black border_value"),
        *_fields(_pointer, "channel_weights last_wins"),
        *_fields(_int32, "votes bins is_signed bin_before"),
        *_fields(_double, "tiny up bins_per_half_turn bin_offset slope"),
        *_fields(_int64, "directions_count"),
        *_fields(_pointer, "directions arctangent"),
        *_fields(_double, "arccosine_least arccosine_unit"),
        *_fields(AxisStruct, "rows cols"),
        *_fields(ctypes.c_char_p, "normalizer"),
        *_fields(_int64, "out_rows out_cols out_channels"),
        *_fields(_pointer, "constants"),
    ]


class Stretches(NamedTuple):
    """Eq. 5-6 along one axis.

    A stretch is neighbouring pixels that vote into the same ``extent`` neighbouring cells: a *band* of rows, or a *run*
    of columns.
    """

    cells: int
    extent: int  # 1 or even
    limits: npt.NDArray[np.int64]  # (stretches, 3): the first pixel, the one after the last, the first cell
    weights: npt.NDArray[Any]  # (pixels, extent), of pixels in the cells of their stretch

    @property
    def longest(self) -> int:
        """Pixels of the longest stretch."""
        return int((self.limits[:, 1] - self.limits[:, 0]).max(initial=1))

    def by_stretch(self, length: int) -> npt.NDArray[Any]:
        """The weights (stretches, extent, length) of each stretch, with zeros behind them."""
        begins, ends, _ = self.limits.T
        pixels = np.minimum(begins[:, np.newaxis] + np.arange(length), len(self.weights) - 1)
        inside = np.arange(length) < (ends - begins)[:, np.newaxis, np.newaxis]
        return np.where(inside, self.weights[pixels].transpose(0, 2, 1), 0)


def pooling_stretches(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> tuple[Stretches, Stretches]:
    """The axes of rows and columns for images of this size, with weights in float32 or float64."""
    rows, cols = map(_stretches, pixel_cells(spec, height, width, dtype))
    return rows, cols


def _stretches(along: PixelCells) -> Stretches:
    extent = along.reach if along.reach == 1 else -(-along.reach // 2) * 2
    first, stop = along.first.tolist(), along.stop.tolist()
    stretches: list[tuple[int, int, int]] = []
    for pixel in along.voting.tolist():
        begin, end, cell = stretches[-1] if stretches else (0, -1, 0)
        if pixel == end and cell <= first[pixel] and stop[pixel] <= cell + extent:
            stretches[-1] = begin, pixel + 1, cell
        else:
            stretches.append((pixel, pixel + 1, first[pixel]))
    table = np.array(stretches, np.int64).reshape(-1, 3)
    cells = np.repeat(table[:, 2], table[:, 1] - table[:, 0])[:, np.newaxis] + np.arange(extent)
    voted = along.weights(along.voting[:, np.newaxis], cells)
    weights = np.zeros((len(first), extent), voted.dtype)
    weights[along.voting] = voted
    return Stretches(along.cells, extent, table, weights)


class NormTables:
    """The part of ``nablahog_tables`` that is about the normaliser, with the arrays that it points to.

    Args:
        spec: a dialect of one colour.
        rows, cols: of the cells.
        dtype: of cells (rows, cols, bins) and descriptors, its ``grid`` (rows, cols, channels); float32 or float64.
    """

    def __init__(self, spec: HOGSpec, rows: int, cols: int, dtype: torch.dtype) -> None:
        norm = spec.normalizer
        self.dtype, self.cells = dtype, (rows, cols, spec.bins)
        self.grid = norm.footprint(0).count(rows), norm.footprint(1).count(cols), spec.channels
        self._alive: list[Any] = []
        self.struct = TablesStruct(
            pixels=PIXEL_CODES[dtype],
            bins=spec.bins,
            rows=AxisStruct(cells=rows),
            cols=AxisStruct(cells=cols),
            normalizer=norm.kind.encode() if has_normalizer(norm.kind) else None,
            out_rows=self.grid[0],
            out_cols=self.grid[1],
            out_channels=self.grid[2],
            constants=self._address(norm.native_constants(spec.bins, spec.signed), np.float64),
        )
        self.address = ctypes.addressof(self.struct)

    def _address(self, values: npt.ArrayLike, dtype: Any) -> int:
        """The address of an array that lives as long as the tables."""
        array = np.ascontiguousarray(values, dtype)
        self._alive.append(array)
        return int(array.ctypes.data)


class ImageTables(NormTables):
    """``nablahog_tables`` of a dialect, an image size and a dtype.

    Args:
        spec: a dialect of one colour.
        shape: (channels, height, width) of the images.
        stored: dtype of the images.

    Raises:
        ValueError: the images are too small for a descriptor.
    """

    def __init__(self, spec: HOGSpec, shape: tuple[int, int, int], stored: torch.dtype) -> None:
        channels, height, width = shape
        spec.grid(height, width)
        super().__init__(spec, *spec.cells(height, width), torch.float64 if stored == torch.float64 else torch.float32)
        self._real, self._integer = (np.float64, np.int64) if self.dtype == torch.float64 else (np.float32, np.int32)
        rows, cols = pooling_stretches(spec, height, width, self.dtype)
        self._set(
            channels=channels,
            height=height,
            width=width,
            pixels=PIXEL_CODES[stored],
            rows=self._axis(rows),
            cols=self._columns(cols),
        )
        self._set_gradients(spec, channels, height, width, stored)
        self._set_votes(spec)

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            setattr(self.struct, name, value)

    def _set_gradients(self, spec: HOGSpec, channels: int, height: int, width: int, stored: torch.dtype) -> None:
        averaged, weights = channel_weights(spec, channels)
        border = BORDERS[spec.border]
        last_wins = np.zeros(_padded(width), self._integer)
        last_wins[:width] = -last_of_equals(spec, height, width).astype(self._integer)
        self._set(
            averaged=averaged,
            square_root=spec.gamma == "sqrt",
            sobel=spec.mask == "sobel",
            border=MIRROR if border.times == 0 else REPEAT if border.beyond is None else CONSTANT,
            border_doubled=border.times == 2,
            scale=spec.value_range / 255 if stored == torch.uint8 else spec.value_range,
            black=BLACK,
            border_value=(border.beyond or 0) * spec.value_range,
            channel_weights=self._address(weights, np.float64),
            last_wins=self._address(last_wins, self._integer),
        )

    def _set_votes(self, spec: HOGSpec) -> None:
        directions = vote_directions(spec)
        up = -1.0 if spec.counterclockwise else 1.0
        self._set(
            votes=VOTE_CODES[vote_rule(spec).name],
            is_signed=spec.signed,
            bin_before=spec.bins - 1 + beginnings(spec)[1],
            tiny=vanishing(self.dtype),
            up=up,
            bins_per_half_turn=spec.bins / 2 if spec.signed else spec.bins,  # exact: right angles are kinks
            bin_offset=spec.bin_offset,
            slope=up * spec.bins / spec.period,
            directions_count=directions.shape[1],
            directions=self._address(directions, np.float64),
            arctangent=self._address(opencv_table(spec), np.float32),
            arccosine_least=VLFEAT_LEAST,
            arccosine_unit=math.pi / (spec.bins // 2 if spec.signed else spec.bins),
        )

    def _axis(self, axis: Stretches) -> AxisStruct:
        return AxisStruct(
            pixels=len(axis.weights),
            cells=axis.cells,
            extent=axis.extent,
            stretches=len(axis.limits),
            longest=axis.longest,
            run=-(-axis.longest // 8) * 8,
            stretch=self._address(axis.limits, np.int64),
            weights=self._address(axis.weights, self._real),
        )

    def _columns(self, axis: Stretches) -> AxisStruct:
        struct = self._axis(axis)
        cell_weights = np.zeros((axis.extent, _padded(len(axis.weights))), self._real)
        cell_weights[:, : len(axis.weights)] = axis.weights.T
        struct.run_weights = self._address(axis.by_stretch(struct.run), self._real)
        struct.cell_weights = self._address(cell_weights, self._real)
        return struct


def _padded(width: int) -> int:
    return -(-width // COLUMN_PADDING) * COLUMN_PADDING + COLUMN_PADDING
