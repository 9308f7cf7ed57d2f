"""Windows of a padded image: where they lie, their descriptors and their scores.

The loops are those of ``native/opencv.cpp``; where there is no native library, the steps of :mod:`nablahog.hog` give
the same, with gradients that are taken here: ``hog`` has no padding whose outermost pixels have gradients.
"""

from __future__ import annotations

import ctypes
import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from ... import native
from ...hog import BlockNorm, HOGSpec
from ...hog.layout import to_layout
from ...hog.orientation import opencv_angle, opencv_table
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


_INTEGERS = (
    *("gamma", "bins", "window_width", "window_height", "block_width", "block_height"),
    *("across", "down", "cell_cols", "cell_rows"),
)


class Constants(ctypes.Structure):
    """``Scheme`` of ``native/opencv_votes.h``."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in _INTEGERS),
        ("polynomial", ctypes.c_float * 7),
        *((name, ctypes.c_float) for name in ("offset", "epsilon", "epsilon_again", "clip")),
    ]


class Scheme(NamedTuple):
    """Describes the windows of one dialect.

    Attributes:
        spec: the dialect.
        rows: of blocks in a window.
        cols: of these.
        constants: of the loops.
        by_col: weights (cols, width) of a block's pixels in its columns of cells.
        by_row: the same of rows, (rows, height).
    """

    spec: HOGSpec
    rows: int
    cols: int
    constants: Constants
    by_col: NDArray[np.float32]
    by_row: NDArray[np.float32]

    @property
    def size(self) -> int:
        """Numbers of a descriptor."""
        return self.rows * self.cols * self.spec.channels


def make_scheme(window: Size, spec: HOGSpec) -> Scheme:
    """The scheme for windows of (width, height), in a dialect of :func:`nablahog.presets.opencv`."""
    assert isinstance(spec.pooling, BlockCells)
    assert isinstance(spec.normalizer, BlockNorm)
    (height, width), (down, across), norm = spec.pooling.block, spec.pooling.step, spec.normalizer
    by_row, by_col = (
        along.spread(torch.eye(along.cells), -1).numpy() for along in pooling_axes(spec, height, width, torch.empty(0))
    )
    rows, cols = spec.grid(window[1], window[0])
    constants = Constants(
        gamma=spec.gamma == "sqrt",
        bins=spec.bins,
        window_width=window[0],
        window_height=window[1],
        block_width=width,
        block_height=height,
        across=across,
        down=down,
        cell_cols=len(by_col),
        cell_rows=len(by_row),
        polynomial=opencv_table(spec),
        offset=spec.bin_offset,
        epsilon=norm.epsilon,
        epsilon_again=norm.epsilon_again,
        clip=norm.clip,
    )
    return Scheme(spec, rows, cols, constants, by_col, by_row)


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


def _plain_gradient_votes(
    padded: Padded, spec: HOGSpec
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Both votes of all pixels and the bins of the first; those of the second are the next ones.  All (rows, cols)."""
    gx, gy = _gradients(padded, spec)
    position = opencv_angle(torch.from_numpy(gx), torch.from_numpy(gy), spec).numpy()
    before, magnitude = np.floor(position), np.sqrt(gx * gx + gy * gy)
    f = position - before
    return magnitude * (1 - f), magnitude * f, before.astype(np.int64) % spec.bins


def _plain_descriptors(padded: Padded, corners: NDArray[np.int64], scheme: Scheme) -> NDArray[np.float32]:
    """:func:`describe_windows` in PyTorch: blocks from one pixel on serve all windows whole strides from it."""
    spec, rows, cols = scheme.spec, scheme.rows, scheme.cols
    assert isinstance(spec.pooling, BlockCells)
    near, far, bins = (torch.from_numpy(plane)[None, None] for plane in _plain_gradient_votes(padded, spec))
    histograms = torch.zeros(1, spec.bins, *bins.shape[2:]).scatter_(1, bins, near)
    histograms.scatter_add_(1, (bins + 1) % spec.bins, far)
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
_dialect = ctypes.POINTER(Padded), ctypes.POINTER(Constants)
_windows = *_dialect, _floats, _floats, native.array(np.int64), ctypes.c_int64
_votes = native.function("opencv_votes", *_dialect, _floats, _floats, native.array(np.int32))
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
    _descriptors(padded, scheme.constants, scheme.by_col, scheme.by_row, corners, len(corners), out)
    return out


def score_windows(
    padded: Padded, corners: NDArray[np.int64], scheme: Scheme, coefficients: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Dot products (windows,) of descriptors with a linear detector; its bias, if it has one, comes last."""
    weights, bias = coefficients[: scheme.size], float(coefficients[scheme.size :].sum())
    products = np.empty(len(corners), np.float32)
    if native.available():
        dialect = scheme.constants, scheme.by_col, scheme.by_row
        _scores(padded, *dialect, corners, len(corners), weights, products)
    else:
        products[:] = describe_windows(padded, corners, scheme) @ weights
    return products.astype(np.float64) + bias


def gradient_votes(padded: Padded, scheme: Scheme) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Votes (rows, cols, 2) of all pixels, and the two bins that they go to."""
    if native.available():
        near, far, bins = (np.empty(padded.size[::-1], dtype) for dtype in (np.float32, np.float32, np.int32))
        _votes(padded, scheme.constants, near, far, bins)
    else:
        near, far, bins = _plain_gradient_votes(padded, scheme.spec)
    return np.stack([near, far], axis=2), np.stack([bins, (bins + 1) % scheme.spec.bins], axis=2).astype(np.uint8)
