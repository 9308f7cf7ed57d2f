"""Windows of a padded image: where they lie, their descriptors and their scores.

The loops are those of ``native/opencv.cpp``; where there is no native library, the steps of :mod:`nablahog.hog`
give the same, with gradients that are taken here: ``hog`` has no padding whose outermost pixels have gradients.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from ... import native
from ...hog import BlockNorm, HOGSpec
from ...hog.descriptor import byte_tables
from ...hog.layout import to_layout
from ...hog.orientation import opencv_angle
from ...hog.poolings import BlockCells
from ...hog.steps import pool, pooling_axes
from .arguments import Size

_SIZES = "height", "width", "channels", "top", "left", "padded_height", "padded_width"


class Padded(ctypes.Structure):
    """``PaddedImage`` of ``native/opencv_votes.h``: an image padded by reflection at its outermost pixels.

    Attributes:
        image: (rows, cols, channels).
        before: (x, y) pixels of padding on the left and at the top.
        after: the same on the right and at the bottom.
        size: (width, height) with the padding.
    """

    _fields_ = [("pixels", ctypes.c_void_p), *((name, ctypes.c_int64) for name in _SIZES)]

    def __init__(self, image: NDArray[np.uint8], before: Size, after: Size) -> None:
        height, width, channels = image.shape
        self.image, self.before, self.after = image, before, after
        self.size = width + before[0] + after[0], height + before[1] + after[1]
        super().__init__(image.ctypes.data, height, width, channels, *before[::-1], *self.size[::-1])

    def inside(self, corners: NDArray[np.int64], window: Size) -> NDArray[np.bool_]:
        """Which windows lie in the padded image."""
        inside: NDArray[np.bool_] = np.all((corners >= 0) & (corners <= np.subtract(self.size, window)), axis=1)
        return inside


_INTEGERS = "bins window_width window_height block_width block_height across down cell_cols cell_rows"


class Scheme(ctypes.Structure):
    """``Scheme`` of ``native/opencv_blocks.h``, for windows of (width, height).

    Attributes:
        spec: the dialect, of :func:`nablahog.presets.opencv`.
        rows: of blocks in a window.
        cols: of these.
        size: numbers of a descriptor.
        tables: of the operator's loops, for gradients and votes.
    """

    _fields_ = [
        *((name, ctypes.c_int64) for name in _INTEGERS.split()),
        *((name, ctypes.c_void_p) for name in ("by_col", "by_row")),
        *((name, ctypes.c_float) for name in ("epsilon", "epsilon_again", "clip")),
    ]

    def __init__(self, window: Size, spec: HOGSpec) -> None:
        assert isinstance(spec.pooling, BlockCells)
        assert isinstance(spec.normalizer, BlockNorm)
        (height, width), (down, across), norm = spec.pooling.block, spec.pooling.step, spec.normalizer
        self.spec, self._window = spec, window
        self.rows, self.cols = spec.grid(window[1], window[0])
        self.size = self.rows * self.cols * spec.channels
        self.tables = byte_tables(spec, (3, height, width))
        self._weights = by_row, by_col = [
            along.spread(torch.eye(along.cells, dtype=torch.float32), -1).contiguous().numpy()
            for along in pooling_axes(spec, height, width, torch.empty(0, dtype=torch.float32))
        ]
        sizes = *window, width, height, across, down, len(by_col), len(by_row)
        addresses = by_col.ctypes.data, by_row.ctypes.data
        super().__init__(spec.bins, *sizes, *addresses, norm.epsilon, norm.epsilon_again, norm.clip)

    def __reduce__(self) -> tuple[Callable[..., Scheme], tuple[Size, HOGSpec]]:  # addresses are those of one process
        return make_scheme, (self._window, self.spec)


@lru_cache(maxsize=16)
def make_scheme(window: Size, spec: HOGSpec) -> Scheme:
    """The scheme, which descriptors of the same parameters share."""
    return Scheme(window, spec)


def _gradients(padded: Padded, spec: HOGSpec) -> NDArray[np.float32]:
    """Gx, Gy (2, rows, cols) of all pixels, of the channel of largest magnitude."""
    (left, top), (right, bottom) = padded.before, padded.after
    around = (top + 1, bottom + 1), (left + 1, right + 1), (0, 0)
    values = np.pad(padded.image, around, mode="reflect").astype(np.float32)
    values = np.sqrt(values) if spec.gamma == "sqrt" else values
    both = np.stack([values[1:-1, 2:] - values[1:-1, :-2], values[2:, 1:-1] - values[:-2, 1:-1]])
    squared = np.square(both).sum(axis=0)
    first, last = squared.argmax(axis=2), squared.shape[2] - 1 - squared[..., ::-1].argmax(axis=2)
    width = squared.shape[1]
    # among ties the first channel, but the last one in the last columns, which OpenCV computes one by one
    winner = np.where(np.arange(width) < width // 4 * 4, first, last)
    return np.take_along_axis(both, winner[None, ..., None], axis=3)[..., 0]


def _plain_gradient_votes(padded: Padded, spec: HOGSpec) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """:func:`gradient_votes` in PyTorch."""
    gx, gy = _gradients(padded, spec)
    position = opencv_angle(torch.from_numpy(gx), torch.from_numpy(gy), spec).numpy()
    before, magnitude = np.floor(position), np.sqrt(gx * gx + gy * gy)
    f = position - before
    bins = before.astype(np.int64)[..., None] + (0, 1)
    return np.stack([magnitude * (1 - f), magnitude * f], axis=2), (bins % spec.bins).astype(np.uint8)


def _plain_descriptors(padded: Padded, corners: NDArray[np.int64], scheme: Scheme) -> NDArray[np.float32]:
    """:func:`describe_windows` in PyTorch: blocks from one pixel on serve all windows whole strides from it."""
    spec, rows, cols = scheme.spec, scheme.rows, scheme.cols
    assert isinstance(spec.pooling, BlockCells)
    votes, bins = (torch.from_numpy(pixels).movedim(2, 0) for pixels in _plain_gradient_votes(padded, spec))
    histograms = torch.zeros(1, spec.bins, *bins.shape[1:]).scatter_add_(1, bins[None].long(), votes[None])
    strides, stride = corners[:, ::-1] // spec.pooling.step, corners[:, ::-1] % spec.pooling.step
    out = np.empty((len(corners), scheme.size), np.float32)
    for y, x in np.unique(stride, axis=0):
        cells = pool(histograms[..., y:, x:], spec)
        blocks = spec.normalizer.normalize(cells, spec.signed)[0]
        windows = blocks.unfold(1, rows, 1).unfold(2, cols, 1)  # (channels, rows, columns of windows, rows, cols)
        some = (stride == (y, x)).all(axis=1)
        row, col = torch.from_numpy(strides[some].T)
        out[some] = to_layout(windows[:, row, col].permute(1, 2, 3, 0), spec).numpy()
    return out


_floats = native.array(np.float32)
_image = ctypes.POINTER(Padded), ctypes.c_void_p
_windows = *_image, ctypes.POINTER(Scheme), native.array(np.int64), ctypes.c_int64
_votes = native.function("opencv_votes", *_image, _floats, native.array(np.uint8))
_descriptors = native.function("opencv_descriptors", *_windows, _floats)
_scores = native.function("opencv_scores", *_windows, _floats, _floats)


def place_windows(
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
    if max(padded.size) >= 2**31:
        raise ValueError(f"an image with its padding must have fewer than 2**31 rows and columns, got {padded.size}")
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


def describe_windows(padded: Padded, corners: NDArray[np.int64], scheme: Scheme) -> NDArray[np.float32]:
    """Descriptors (windows, numbers) of windows in the padded image."""
    if not native.available():
        return _plain_descriptors(padded, corners, scheme)
    out = np.empty((len(corners), scheme.size), np.float32)
    _descriptors(padded, scheme.tables.address, scheme, corners, len(corners), out)
    return out


def score_windows(
    padded: Padded, corners: NDArray[np.int64], scheme: Scheme, coefficients: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Dot products (windows,) of descriptors with a linear detector; its bias, if it has one, comes last."""
    weights, bias = coefficients[: scheme.size], float(coefficients[scheme.size :].sum())
    products = np.empty(len(corners), np.float32)
    if native.available():
        _scores(padded, scheme.tables.address, scheme, corners, len(corners), weights, products)
    else:
        products[:] = describe_windows(padded, corners, scheme) @ weights
    return products.astype(np.float64) + bias


def gradient_votes(padded: Padded, scheme: Scheme) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Votes (rows, cols, 2) of all pixels, and the two bins that they go to."""
    if not native.available():
        return _plain_gradient_votes(padded, scheme.spec)
    votes, bins = (np.empty((*padded.size[::-1], 2), dtype) for dtype in (np.float32, np.uint8))
    _votes(padded, scheme.tables.address, votes, bins)
    return votes, bins
