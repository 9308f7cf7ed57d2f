"""The reference of the four steps: operations of PyTorch, on any device, differentiable any number of times.

Eq. 5-6 are computed from the taps of a pooling, and so are the tables of loops: :mod:`.kernels` has the steps compiled
for CPUs, :mod:`.triton` for GPUs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .gradient import gradient
from .orientation import votes
from .poolings import Taps
from .spec import COLOURS, HOGSpec

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


def _scaled(images: Tensor, spec: HOGSpec) -> Tensor:
    """Images in 0…``spec.value_range``, floating point."""
    if images.dtype == torch.uint8:
        return images.to(torch.get_default_dtype()) * (spec.value_range / 255)
    return images if spec.value_range == 1 else images * spec.value_range


def spread_nan(x: Tensor, images: Tensor) -> Tensor:
    """``x`` (B, …), NaN with NaN derivatives where the image has a pixel that is not finite, in any channel."""
    if not images.is_floating_point():
        return x
    image = images.detach()
    one_or_nan = 1 + 0 * image.amax((1, 2, 3)) + 0 * image.amin((1, 2, 3))  # neither makes a copy
    return x * one_or_nan.to(x.dtype).reshape(-1, *(1,) * (x.dim() - 1))


def pool(votes: Tensor, spec: HOGSpec) -> Tensor:
    """F^s of Eq. 5-6: votes (B, bins, H, W) to cell histograms (B, bins, rows, cols).  Linear."""
    height, width = votes.shape[-2:]
    rows, cols = pooling_axes(spec, height, width, votes)
    return rows.pool(cols.pool(votes, -1), -2)


def histograms_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, colours · bins, rows, cols)."""
    if spec.colours > 1:
        cells = histograms_reference(separate_colours(images), spec.single_colour)
        return cells.reshape(-1, spec.colours * spec.bins, *cells.shape[2:])
    with torch.autocast(images.device.type, enabled=False):  # its half precision would show in every library's parity
        gx, gy = gradient(spread_nan(_scaled(images, spec), images), spec)  # Eq. 1-2
        return spread_nan(pool(votes(gx, gy, spec), spec), images)  # Eq. 3-6


def normalize_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    cells = histograms.reshape(-1, spec.bins, *histograms.shape[2:])
    with torch.autocast(histograms.device.type, enabled=False):
        descriptor = spec.normalizer.normalize(cells, spec.signed)
    return descriptor.reshape(-1, spec.channels, *descriptor.shape[2:])


def separate_colours(images: Tensor) -> Tensor:
    """Images (B, 1 or 3, H, W) as (3 B, 1, H, W); a pixel that is not finite makes all colours of its image NaN."""
    return spread_nan(images, images).expand(-1, COLOURS, -1, -1).reshape(-1, 1, *images.shape[2:])


def merge_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """From (B · colours, rows, cols, channels) to (B, rows, cols, colours · channels)."""
    return descriptors.reshape(-1, spec.colours, *descriptors.shape[1:]).movedim(1, 3).flatten(3)


def split_colours(descriptors: Tensor, spec: HOGSpec) -> Tensor:
    """The inverse of :func:`merge_colours`."""
    batch, rows, cols, channels = descriptors.shape
    colours = descriptors.reshape(batch, rows, cols, spec.colours, channels // spec.colours)
    return colours.movedim(3, 1).flatten(0, 1)
