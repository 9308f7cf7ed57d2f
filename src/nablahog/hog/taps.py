"""Eq. 5-6 along one axis of an image, from the taps of a pooling: as operations of PyTorch, and for tables of loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .poolings import Taps
from .spec import HOGSpec

PIECE = 512  # pixels; dense weights of a whole axis would grow with its square


class Piece(NamedTuple):
    """Some neighbouring pixels of an axis, and the cells that they vote into."""

    pixels: slice
    cells: slice
    weights: Tensor  # (cells, pixels)


class AxisPooling(NamedTuple):
    """Weights of pixels in cells along one axis; all pixels are in pieces, one after the other."""

    cells: int
    pieces: list[Piece]

    def pool(self, votes: Tensor, dim: int) -> Tensor:
        """Sums of votes, for all pixels along ``dim`` (-1 or -2) those of all cells.  Linear."""
        parts = torch.split(votes, [piece.weights.shape[1] for piece in self.pieces], dim)
        pooled = [
            part @ piece.weights.T if dim == -1 else piece.weights @ part
            for part, piece in zip(parts, self.pieces, strict=True)
        ]
        return self._add(pooled, dim)

    def spread(self, values: Tensor, dim: int) -> Tensor:
        """The transpose of :meth:`pool`: from values of all cells to those of all pixels."""
        parts = (values.narrow(dim, p.cells.start, p.cells.stop - p.cells.start) for p in self.pieces)
        return torch.cat(
            [
                part @ piece.weights if dim == -1 else piece.weights.T @ part
                for part, piece in zip(parts, self.pieces, strict=True)
            ],
            dim,
        )

    def totals(self) -> Tensor:
        """(cells,): the sum of all weights in each cell."""
        return self._add([piece.weights.sum(dim=1) for piece in self.pieces], -1)

    def map(self, function: Callable[[Tensor], Tensor]) -> AxisPooling:
        """The same with other weights, from the weights (cells, pixels) of each piece."""
        pieces = [piece._replace(weights=function(piece.weights)) for piece in self.pieces]
        return AxisPooling(self.cells, pieces)

    def _add(self, parts: list[Tensor], dim: int) -> Tensor:
        """Sums over pieces: neighbouring ones share some cells."""
        if len(parts) == 1:
            return parts[0]
        cells = [torch.arange(p.cells.start, p.cells.stop, device=p.weights.device) for p in self.pieces]
        joined = torch.cat(parts, dim)
        shape = list(joined.shape)
        shape[dim] = self.cells
        return joined.new_zeros(shape).index_add(dim, torch.cat(cells), joined)


def pooling_taps(spec: HOGSpec, height: int, width: int, like: Tensor) -> tuple[Taps, Taps]:
    """Taps of the rows and columns of an image, dtype of their weights and device of ``like``."""
    rows, cols = (
        spec.pooling.taps(pixels, cells, cell, axis, spec.border == "ignore", like)
        for axis, (pixels, cells, cell) in enumerate(
            zip((height, width), spec.cells(height, width), spec.cell_size, strict=True)
        )
    )
    return rows, cols


def pooling_axes(spec: HOGSpec, height: int, width: int, like: Tensor) -> tuple[AxisPooling, AxisPooling]:
    """The pooling along the rows and the columns of an image, dtype and device of ``like``."""
    rows, cols = (
        _pieces(taps, pixels, cells, spec, axis)
        for axis, (taps, pixels, cells) in enumerate(
            zip(pooling_taps(spec, height, width, like), (height, width), spec.cells(height, width), strict=True)
        )
    )
    return rows, cols


def _pieces(taps: Taps, pixels: int, cells: int, spec: HOGSpec, axis: int) -> AxisPooling:
    if pixels <= PIECE:
        return AxisPooling(cells, [_piece(taps, slice(0, pixels), slice(0, cells))])
    cell = spec.cell_size[axis]
    step, at_once = spec.pooling.spacing(cell, axis)
    before, after = spec.pooling.reach(cell, axis)
    pieces = []
    for start in range(0, pixels, PIECE):
        stop = min(start + PIECE, pixels)
        first = max((start - after) // step + 1, 0) * at_once  # whose last pixel is within the piece, or later
        last = min(-(-(stop + before) // step) * at_once, cells)
        pieces.append(_piece(taps, slice(start, stop), slice(min(first, last), last)))
    return AxisPooling(cells, pieces)


def _piece(taps: Taps, pixels: slice, cells: slice) -> Piece:
    first, weights = taps.first[pixels] - cells.start, taps.weights[pixels]
    count, reach = cells.stop - cells.start, weights.shape[1]
    dense = weights.new_zeros(count + 1, len(first))  # and of a row for cells that do not exist
    for k in range(reach):
        row = first + k
        row = torch.where((row >= 0) & (row < count), row, count).unsqueeze(0)
        dense.scatter_(0, row, weights[:, k].unsqueeze(0))
    return Piece(pixels, cells, dense[:-1])


class PixelCells:
    """The cells that each pixel along an axis really votes into, for tables of loops.

    Attributes:
        cells: along the axis.
        first, stop: (pixels,), the first of them, and the one after the last; 0 and 0 where a pixel does not vote.
    """

    def __init__(self, taps: Taps, cells: int) -> None:
        self.cells = cells
        self._first, weights = taps.first.numpy(), taps.weights.numpy()
        cell = self._first[:, np.newaxis] + np.arange(weights.shape[1])
        self._weights = np.where((cell >= 0) & (cell < cells), weights, 0)
        is_vote = self._weights != 0
        voting = is_vote.any(axis=1)
        self.first = np.where(voting, self._first + is_vote.argmax(axis=1), 0)
        self.stop = np.where(voting, self._first + is_vote.shape[1] - is_vote[:, ::-1].argmax(axis=1), 0)

    @property
    def voting(self) -> NDArray[np.int64]:
        """The pixels that vote."""
        return np.flatnonzero(self.stop)

    @property
    def reach(self) -> int:
        """The most neighbouring cells that a pixel votes into, at least 1."""
        return max(int((self.stop - self.first).max()), 1)

    def weights(self, pixel: NDArray[np.int64], cell: NDArray[np.int64]) -> NDArray[Any]:
        """Weights of pixels in cells, broadcast together; 0 where there is no such cell."""
        tap = cell - self._first[pixel]
        has_tap = (tap >= 0) & (tap < self._weights.shape[1])
        return np.where(has_tap, self._weights[pixel, np.where(has_tap, tap, 0)], 0)


def pixel_cells(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> tuple[PixelCells, PixelCells]:
    """Of the rows and columns of an image, with weights in float32 or float64."""
    taps = pooling_taps(spec, height, width, torch.empty(0, dtype=dtype, device="cpu"))
    rows, cols = map(PixelCells, taps, spec.cells(height, width))
    return rows, cols
