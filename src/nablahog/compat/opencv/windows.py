"""Windows of a padded image: where they lie, and their descriptors and scores."""

from __future__ import annotations

import ctypes
import math

import numpy as np
from numpy.typing import NDArray

from ... import native
from . import reference
from .arguments import Size
from .padded import Padded
from .scheme import Constants, Scheme

_floats = native.array(np.float32)
_dialect = ctypes.POINTER(Padded), ctypes.POINTER(Constants)
_windows = *_dialect, _floats, _floats, native.array(np.int64), ctypes.c_int64
_votes = native.function("opencv_votes", *_dialect, _floats, _floats, native.array(np.int32))
_descriptors = native.function("opencv_descriptors", *_windows, _floats)
_scores = native.function("opencv_scores", *_windows, _floats, _floats)


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


def descriptors(padded: Padded, corners: NDArray[np.int64], scheme: Scheme) -> NDArray[np.float32]:
    """Descriptors (windows, numbers) of windows in the padded image."""
    if not native.available():
        return reference.descriptors(padded, corners, scheme.spec, scheme.rows, scheme.cols)
    out = np.empty((len(corners), scheme.size), np.float32)
    _descriptors(padded, scheme.constants, scheme.by_col, scheme.by_row, corners, len(corners), out)
    return out


def scores(
    padded: Padded, corners: NDArray[np.int64], scheme: Scheme, coefficients: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Dot products (windows,) of descriptors with a linear detector; its bias, if it has one, is behind."""
    weights, bias = coefficients[: scheme.size], float(coefficients[scheme.size :].sum())
    products = np.empty(len(corners), np.float32)
    if native.available():
        dialect = scheme.constants, scheme.by_col, scheme.by_row
        _scores(padded, *dialect, corners, len(corners), weights, products)
    else:
        products[:] = descriptors(padded, corners, scheme) @ weights
    return products.astype(np.float64) + bias


def gradients(padded: Padded, scheme: Scheme) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Votes (rows, cols, 2) of all pixels, and the two bins that they go to."""
    if native.available():
        near, far, bins = (np.empty(padded.size[::-1], dtype) for dtype in (np.float32, np.float32, np.int32))
        _votes(padded, scheme.constants, near, far, bins)
    else:
        near, far, bins = reference.votes(padded, scheme.spec)
    return np.stack([near, far], axis=2), np.stack([bins, (bins + 1) % scheme.spec.bins], axis=2).astype(np.uint8)
