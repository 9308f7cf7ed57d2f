"""Windows of a padded image: where they lie, and their descriptors and scores from grids of blocks.

A grid serves all windows whose corners are whole strides of blocks apart; windows between them need grids of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hog import HOGSpec
from ...runtime.arrays import Flags, Floats, Integers
from ...runtime.simd import PADDING
from .arguments import Size
from .blocks import Blocks, block_grid, blocks
from .scores import TOGETHER, window_scores
from .votes import Angles, Region, angles, votes_of_region


class Scheme(NamedTuple):
    """What describes windows of one dialect."""

    window: Size
    angles: Angles
    blocks: Blocks
    rows: int  # of blocks in a window
    cols: int
    numbers: int  # of a block

    @property
    def size(self) -> int:
        """Numbers of a descriptor."""
        return self.rows * self.cols * self.numbers


def scheme(window: Size, spec: HOGSpec) -> Scheme:
    """Of windows of (width, height), in a dialect of :func:`nablahog.presets.opencv`."""
    rows, cols = spec.grid(window[1], window[0])
    return Scheme(window, angles(spec), blocks(spec), rows, cols, spec.channels)


class Detector(NamedTuple):
    """A linear detector: weights of the columns of blocks of a window, each padded to whole vectors, and a bias."""

    weights: Floats
    bias: float


def detector(coefficients: NDArray[np.float32], scheme: Scheme) -> Detector:
    """Of the descriptor's weights, with or without a bias behind."""
    run = scheme.rows * scheme.numbers
    weights = np.zeros((scheme.cols, -(-run // PADDING) * PADDING), np.float32)
    weights[:, :run] = coefficients[: scheme.size].reshape(scheme.cols, run)
    return Detector(weights.reshape(-1), float(coefficients[scheme.size]) if len(coefficients) > scheme.size else 0.0)


class Padded:
    """An image (rows, cols, channels), padded by reflection at its outermost pixels.

    Attributes:
        margins: (x, y) pixels of padding on the left and at the top.
        size: (width, height) with the padding.
    """

    def __init__(self, image: NDArray[np.uint8], before: Size, after: Size) -> None:
        height, width, self.channels = image.shape
        self.values, self.margins = image.reshape(-1), before
        self.size = width + before[0] + after[0], height + before[1] + after[1]
        self.pixel_of = _reflected(width, before[0], after[0], self.channels)
        self.row_of = _reflected(height, before[1], after[1], width * self.channels)

    def region(self, x: int, y: int, width: int, height: int) -> Region:
        """A part; its corner is in pixels of the padded image."""
        rows, cols = self.row_of[y : y + height + 2], self.pixel_of[x : x + width + 2]
        return Region(self.values, self.channels, rows, cols, self.size[0] // 4 * 4 - x)

    def inside(self, corners: Integers, window: Size) -> Flags:
        """Which windows lie in the padded image."""
        inside: Flags = np.all((corners >= 0) & (corners <= np.subtract(self.size, window)), axis=1)
        return inside


def placed(
    image: NDArray[np.uint8],
    step: Size,
    padding: Size,
    places: NDArray[np.int64] | None,
    window: Size,
    block_stride: Size,
) -> tuple[Padded, NDArray[np.int64]]:
    """The padded image, and corners (windows, 2) of windows in it: of all, row by row, or at ``places`` of the image.

    OpenCV rounds the padding up to a multiple of the greatest common divisor of both strides if that is a power of two,
    and otherwise to the number that the same bits give.
    """
    around = tuple((p + g - 1) & -g for p, g in zip(padding, map(math.gcd, step, block_stride), strict=True))
    padded = Padded(image, (around[0], around[1]), (around[0], around[1]))
    if places is not None:
        return padded, places + around
    if padded.size[0] < window[0] or padded.size[1] < window[1]:
        raise ValueError(
            f"the image must hold a window of {window[0]}x{window[1]} pixels (width x height), got "
            f"{padded.size[0]}x{padded.size[1]} with its padding"
        )
    x, y = (np.arange(0, n - w + 1, s) for n, w, s in zip(padded.size, window, step, strict=True))
    corners = np.empty((len(y), len(x), 2), np.int64)
    corners[..., 0], corners[..., 1] = x, y[:, None]
    return padded, corners.reshape(-1, 2)


class _Grid(NamedTuple):
    """Blocks (columns, rows, numbers), with padding behind, and the windows that they serve."""

    values: Floats  # in one line
    rows: int
    windows: Integers  # their numbers
    x: Integers  # of each window, the column of blocks that it begins at
    y: Integers


_entry_points: dict[bool, Callable[..., None]] = {}


def _block_grid(region: Region, scheme: Scheme, out: Floats) -> None:
    """The loop of that name, without Numba's look-up by the types of all arguments: they differ in one respect."""
    arguments = region, scheme.angles, scheme.blocks, out
    writeable = region.values.flags.writeable
    if writeable not in _entry_points:
        _entry_points[writeable] = block_grid.entry_point(*arguments)  # type: ignore[attr-defined]
    _entry_points[writeable](*arguments)


def _grids(padded: Padded, corners: Integers, scheme: Scheme) -> Iterator[_Grid]:
    across, down = scheme.blocks.across, scheme.blocks.down
    group = corners[:, 0] % across * down + corners[:, 1] % down
    alike = len(group) and (group == group[0]).all()  # np.unique takes as long as a window
    for number in group[:1] if alike else np.unique(group):
        windows = np.flatnonzero(group == number)
        some = corners[windows]
        (x, y), (right, bottom) = some.min(axis=0).tolist(), some.max(axis=0).tolist()
        width, height = right - x + scheme.window[0], bottom - y + scheme.window[1]
        cols, rows = (width - scheme.blocks.width) // across + 1, (height - scheme.blocks.height) // down + 1
        values = np.zeros(cols * rows * scheme.numbers + PADDING, np.float32)
        out = values[:-PADDING].reshape(cols, rows, scheme.numbers)
        _block_grid(padded.region(x, y, width, height), scheme, out)
        yield _Grid(values, rows, windows, (some[:, 0] - x) // across, (some[:, 1] - y) // down)


def descriptors(padded: Padded, corners: Integers, scheme: Scheme) -> NDArray[np.float32]:
    """Descriptors (windows, numbers) of windows in the padded image."""
    out = np.empty((len(corners), scheme.cols, scheme.rows * scheme.numbers), np.float32)
    for grid in _grids(padded, corners, scheme):
        column, item = grid.rows * scheme.numbers, grid.values.itemsize
        cols = (len(grid.values) - PADDING) // column
        shape = cols - scheme.cols + 1, grid.rows - scheme.rows + 1, *out.shape[1:]
        strides = column * item, scheme.numbers * item, column * item, item
        windows = np.ndarray(shape, np.float32, grid.values, strides=strides)
        if len(grid.windows) == len(out):
            out = windows[grid.x, grid.y]
        else:
            out[grid.windows] = windows[grid.x, grid.y]
    return out.reshape(len(corners), scheme.size)


def scores(padded: Padded, corners: Integers, scheme: Scheme, detector: Detector) -> NDArray[np.float64]:
    """Dot product with the detector, and its bias, of each window in the padded image."""
    out = np.empty(len(corners), np.float64)
    for grid in _grids(padded, corners, scheme):
        starts = (grid.x * grid.rows + grid.y) * scheme.numbers
        starts = np.append(starts, np.repeat(starts[-1:], -len(starts) % TOGETHER))
        products = np.empty(len(starts), np.float32)
        step = grid.rows * scheme.numbers
        window_scores(grid.values, starts, step, detector.weights, scheme.cols, products)
        out[grid.windows] = products[: len(grid.windows)]
    return out + detector.bias


def gradients(padded: Padded, scheme: Scheme) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Votes (rows, cols, 2) of all pixels, and the two bins that they go to."""
    width, height = padded.size
    near, far, bins = (np.empty((height, width), dtype) for dtype in (np.float32, np.float32, np.int32))
    votes_of_region(padded.region(0, 0, width, height), scheme.angles, near, far, bins)
    after = np.where(bins == scheme.blocks.bins - 1, 0, bins + 1)
    return np.stack([near, far], axis=2), np.stack([bins, after], axis=2).astype(np.uint8)


@lru_cache(maxsize=64)
def _reflected(pixels: int, before: int, after: int, step: int) -> NDArray[np.int64]:
    """Indices that pad an axis by reflection, with one more pixel on each side; pixels are ``step`` numbers apart."""
    index = np.arange(-before - 1, pixels + after + 1) % max(2 * pixels - 2, 1)
    return np.minimum(index, np.maximum(2 * pixels - 2 - index, 0)) * step
