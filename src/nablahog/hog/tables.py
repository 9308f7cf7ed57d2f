"""What the native loops and the GPU's kernels know of a dialect and an image size, as numbers and tables."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from . import library_angles
from .gradient import GRAY_WEIGHTS
from .orientation import beginnings, hard_directions, vote_rule
from .spec import HOGSpec
from .steps import pooling_matrices


def channel_weights(spec: HOGSpec, channels: int) -> tuple[bool, tuple[float, ...]]:
    """Whether so many channels are averaged (Eq. 1), not compared by magnitude, and their weights."""
    if spec.colour != "gray" or channels == 1:
        return False, (1.0,) * channels
    return True, GRAY_WEIGHTS if channels == 3 else (1 / channels,) * channels


def vote_directions(spec: HOGSpec) -> npt.NDArray[np.float64]:
    """What the dialect's rule of votes compares gradients with, (2 or 3, directions): cosines and sines.

    Directions of bins, or where bins begin, and then whether in the first half turn; nothing where votes are by angle.
    """
    rule = vote_rule(spec).name
    if rule == "nearest":
        return hard_directions(spec).astype(np.float64)
    if rule == "vlfeat":
        return library_angles.vlfeat_directions(spec).astype(np.float64)
    return np.array(beginnings(spec)[0], np.float64).T if rule == "begun" else np.zeros((2, 0))


class Axis(NamedTuple):
    """Eq. 5-6 along one axis.

    A stretch is neighbouring pixels that vote into the same ``extent`` neighbouring cells: a *band* of rows, or a *run*
    of columns.

    Attributes:
        cells: along the axis.
        extent: 1 or even.
        stretches: (n, 3): the first pixel, the one after the last, the first cell.
        weights: (pixels, extent), of pixels in the cells of their stretch.
    """

    cells: int
    extent: int
    stretches: npt.NDArray[np.int64]
    weights: npt.NDArray[Any]

    @property
    def longest(self) -> int:
        """Pixels of the longest stretch."""
        return int((self.stretches[:, 1] - self.stretches[:, 0]).max(initial=1))

    def by_stretch(self, length: int) -> npt.NDArray[Any]:
        """The weights (stretches, extent, length) of each stretch, with zeros behind them."""
        table = np.zeros((len(self.stretches), self.extent, length), self.weights.dtype)
        for of_stretch, (begin, end, _) in zip(table, self.stretches, strict=True):
            of_stretch[:, : end - begin] = self.weights[begin:end].T
        return table


def pooling_axes(spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> tuple[Axis, Axis]:
    """Of the rows and the columns of images of that size, with weights in float32 or float64."""
    rows, cols = pooling_matrices(spec, height, width, torch.empty(0, dtype=dtype))
    return _axis(rows.numpy()), _axis(cols.numpy())


def _axis(matrix: npt.NDArray[Any]) -> Axis:
    """From weights (cells, pixels), of which a pixel's cells follow each other."""
    pixels = np.flatnonzero(matrix.any(axis=0))
    first = (matrix != 0).argmax(axis=0)
    last = len(matrix) - 1 - (matrix[::-1] != 0).argmax(axis=0)
    most = int((last - first)[pixels].max(initial=0)) + 1
    extent = most if most == 1 else -(-most // 2) * 2
    stretches: list[tuple[int, int, int]] = []
    for pixel in map(int, pixels):
        begin, end, cell = stretches[-1] if stretches else (0, -1, 0)
        if pixel == end and cell <= first[pixel] and last[pixel] < cell + extent:
            stretches[-1] = begin, pixel + 1, cell
        else:
            stretches.append((pixel, pixel + 1, int(first[pixel])))
    weights = np.zeros((matrix.shape[1], extent), matrix.dtype)
    for begin, end, cell in stretches:
        cells = matrix[cell : cell + extent, begin:end].T
        weights[begin:end, : cells.shape[1]] = cells
    return Axis(len(matrix), extent, np.array(stretches, np.int64).reshape(-1, 3), weights)
