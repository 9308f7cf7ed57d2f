"""Images at smaller scales, byte by byte those of ``cv2.resize(…, interpolation=cv2.INTER_LINEAR_EXACT)``.

OpenCV interpolates in fixed point: weights are multiples of 1/256, and only the result is rounded.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ... import native
from .arguments import Size

_resize = native.function(
    "opencv_resize",
    *(native.array(np.uint8), ctypes.c_int64, ctypes.c_int64),
    *(ctypes.c_int64, native.array(np.int32), native.array(np.int32)) * 2,
    native.array(np.uint8),
)


def _axis(pixels: int, resized: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The pixels to interpolate from, and the weights of those behind them in 1/256."""
    inverse = 1 / (resized / pixels)  # as OpenCV rounds it
    position = inverse * (np.arange(resized) + 0.5) - 0.5
    before = np.floor(position)
    inside = (before >= 0) & (before < pixels - 1)
    weight = np.where(inside, np.rint((position - before) * 256), 0)
    return np.clip(before, 0, pixels - 1).astype(np.int32), weight.astype(np.int32)


def levels(size: Size, window: Size, scale: float, most: int) -> list[float]:
    """By how much an image of (width, height) is made smaller: at least once 1, and as long as a window fits in."""
    scales = [1.0]
    while scale > 1 and len(scales) < most:
        next_ = scales[-1] * scale
        if any(round(pixels / next_) < side for pixels, side in zip(size, window, strict=True)):
            break
        scales.append(next_)
    return scales


def resized(image: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    """An image (rows, columns, channels), contiguous, at (width, height)."""
    height, width, channels = image.shape
    if size == (width, height):
        return image
    (left, right_weight), (upper, lower_weight) = _axis(width, size[0]), _axis(height, size[1])
    if native.available():
        out = np.empty((size[1], size[0], channels), np.uint8)
        _resize(image, width, channels, size[1], upper, lower_weight, size[0], left, right_weight, out)
        return out
    right, lower = np.minimum(left + 1, width - 1), np.minimum(upper + 1, height - 1)
    by_row, by_col = lower_weight[:, None, None], right_weight[:, None]
    lines = image[upper] * (256 - by_row) + image[lower] * by_row
    values: NDArray[np.int32] = lines[:, left] * (256 - by_col) + lines[:, right] * by_col
    return ((values + (1 << 15)) >> 16).astype(np.uint8)
