"""Images at smaller scales, byte by byte those of ``cv2.resize(…, interpolation=cv2.INTER_LINEAR_EXACT)``.

OpenCV interpolates in fixed point: weights are multiples of 1/256, and only the result is rounded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...runtime.arrays import Bytes, Integers
from ...runtime.compile import compiled
from .arguments import Size


class Axis(NamedTuple):
    """Pixels that are interpolated between: ``low`` and ``high``, and the weight of the latter in 1/256."""

    low: Integers
    high: Integers
    weight: Integers


def _axis(pixels: int, resized: int) -> Axis:
    inverse = 1 / (resized / pixels)  # as OpenCV rounds it
    position = inverse * (np.arange(resized) + 0.5) - 0.5
    before = np.floor(position)
    inside = (before >= 0) & (before < pixels - 1)
    weight = np.where(inside, np.rint((position - before) * 256), 0).astype(np.int32)
    low = np.clip(before, 0, pixels - 1).astype(np.int64)
    return Axis(low, np.minimum(low + 1, pixels - 1), weight)


@compiled
def _interpolate(image: Bytes, rows: Axis, cols: Axis, out: Bytes) -> None:
    """``image`` (rows, columns, channels) to ``out``, of the same axes."""
    line = np.zeros(image.shape[1] * image.shape[2], np.int32)
    half, all_ = np.int32(1 << 15), np.int32(256)
    for y in range(out.shape[0]):
        upper, lower, weight = image[rows.low[y]].reshape(-1), image[rows.high[y]].reshape(-1), rows.weight[y]
        for k in range(line.size):
            x = np.uintp(k)
            line[x] = np.int32(upper[x]) * (all_ - weight) + np.int32(lower[x]) * weight
        to = out[y].reshape(-1)
        for k in range(to.size):
            x = np.uintp(k)
            value = (
                line[np.uintp(cols.low[x])] * (all_ - cols.weight[x]) + line[np.uintp(cols.high[x])] * cols.weight[x]
            )
            to[x] = np.uint8((value + half) >> np.int32(16))


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
    cols = _axis(width, size[0])
    channel = np.tile(np.arange(channels), size[0])
    low, high = (np.repeat(each, channels) * channels + channel for each in (cols.low, cols.high))
    out = np.empty((size[1], size[0], channels), np.uint8)
    _interpolate(image, _axis(height, size[1]), Axis(low, high, np.repeat(cols.weight, channels)), out)
    return out
