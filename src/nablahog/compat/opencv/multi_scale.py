"""Detection at several scales: smaller images, and the merging of detections that overlap.

Images are byte by byte those of ``cv2.resize(…, interpolation=cv2.INTER_LINEAR_EXACT)``, which interpolates in fixed
point: weights are multiples of 1/256, and only the result is rounded.  The two groupings and the clipping are those
of ``hog.cpp`` and ``cascadedetect.cpp``; rectangles are (N, 4), int32: x, y, width and height in pixels.
"""

from __future__ import annotations

import ctypes
import math
from typing import TypeAlias

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
_EPSILON = 0.2  # differences of similar rectangles, as a share of their sides
_KERNEL = np.array([8.0, 16.0, math.log(1.3)])  # of the mean shift: pixels at scale 1, and the logarithm of a scale


def _interpolate_axis(pixels: int, resized: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The pixels to interpolate from, and the weights of those after them in 1/256."""
    inverse = 1 / (resized / pixels)  # as OpenCV rounds it
    position = inverse * (np.arange(resized) + 0.5) - 0.5
    before = np.floor(position)
    inside = (before >= 0) & (before < pixels - 1)
    weight = np.where(inside, np.rint((position - before) * 256), 0)
    return np.maximum(before, 0).astype(np.int32), weight.astype(np.int32)


def pyramid_scales(size: Size, window: Size, scale: float, most: int) -> list[float]:
    """Factors by which an image of (width, height) is shrunk: 1 first, then further ones while a window fits."""
    scales = [1.0]
    while scale > 1 and len(scales) < most:
        next_ = scales[-1] * scale
        if any(round(pixels / next_) < side for pixels, side in zip(size, window, strict=True)):
            break
        scales.append(next_)
    return scales


def resize(image: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    """An image (rows, columns, channels), contiguous, at (width, height)."""
    height, width, channels = image.shape
    if size == (width, height):
        return image
    (left, right_weight), (upper, lower_weight) = _interpolate_axis(width, size[0]), _interpolate_axis(height, size[1])
    if native.available():
        out = np.empty((size[1], size[0], channels), np.uint8)
        _resize(image, width, channels, size[1], upper, lower_weight, size[0], left, right_weight, out)
        return out
    right, lower = np.minimum(left + 1, width - 1), np.minimum(upper + 1, height - 1)
    by_row, by_col = lower_weight[:, None, None], right_weight[:, None]
    lines = image[upper] * (256 - by_row) + image[lower] * by_row
    values: NDArray[np.int32] = lines[:, left] * (256 - by_col) + lines[:, right] * by_col
    return ((values + (1 << 15)) >> 16).astype(np.uint8)


Rectangles: TypeAlias = NDArray[np.int32]
Weights: TypeAlias = NDArray[np.float64]


def _classify(rectangles: Rectangles) -> NDArray[np.int64]:
    """The class of each rectangle: similar ones, and those similar to these; numbered by their first members."""
    x, y, width, height = rectangles.T.astype(np.float64)
    edges = np.stack([x, y, x + width, y + height])
    labels = np.full(len(rectangles), -1)
    count = 0
    for first in range(len(rectangles)):
        if labels[first] >= 0:
            continue
        labels[first], waiting = count, [first]
        while waiting:
            k = waiting.pop()
            delta = _EPSILON * 0.5 * (np.minimum(width, width[k]) + np.minimum(height, height[k]))
            similar = (np.abs(edges - edges[:, k : k + 1]) <= delta).all(axis=0) & (labels < 0)
            labels[similar] = count
            waiting.extend(np.flatnonzero(similar).tolist())
        count += 1
    return labels


def group_rectangles(rectangles: Rectangles, weights: Weights, threshold: int) -> tuple[Rectangles, Weights]:
    """The mean of each class of more than ``threshold`` rectangles, with its largest weight.

    Small ones inside others are left out.  A threshold of 0 or less groups nothing.
    """
    if threshold <= 0 or not len(rectangles):
        return rectangles, weights
    labels = _classify(rectangles)
    members = np.bincount(labels)
    sums = np.stack([np.bincount(labels, side) for side in rectangles.T], axis=1)
    means = np.rint(sums * (1 / members)[:, None]).astype(np.int32)
    largest = np.full(len(members), -np.inf)
    np.maximum.at(largest, labels, weights)
    many = members > threshold
    outer = [k for k in np.flatnonzero(many).tolist() if not _inside_another(k, means, members, many)]
    return means[outer], largest[outer]


def _inside_another(k: int, means: Rectangles, members: NDArray[np.int64], many: NDArray[np.bool_]) -> bool:
    """Whether a class lies in another of ``many`` with more members, or in any if it has under 3, up to a fifth."""
    margin = np.rint(means[:, 2:] * _EPSILON).astype(np.int64)
    corner, opposite = means[:, :2], means[:, :2] + means[:, 2:]
    within = (corner[k] >= corner - margin).all(axis=1) & (opposite[k] <= opposite + margin).all(axis=1)
    larger = (members > members[k]) | (members[k] < 3)
    others = many & (np.arange(len(means)) != k)
    return bool((within & larger & others).any())


def group_by_mean_shift(
    rectangles: Rectangles, weights: Weights, scales: Weights, threshold: float, window: Size
) -> tuple[Rectangles, Weights]:
    """The modes of the density of detections in place and logarithm of scale, above ``threshold``, with their density.

    Each detection counts with its weight.
    """
    x, y, width, height = rectangles.T.astype(np.float64)
    centres = np.rint(x + width / 2), np.rint(y + height / 2)  # halves to even, as OpenCV's points of integers
    hits = np.stack([*centres, np.log(scales)], axis=1)
    kernels = _kernel_widths(hits[:, 2])
    heights = weights / np.sqrt(kernels.sum(axis=1))
    modes: list[NDArray[np.float64]] = []
    for hit in hits:
        mode = _climb(_shift(hit, hits, kernels, heights), hits, kernels, heights)
        if not any(_distance(mode, other) < 1 for other in modes):
            modes.append(mode)
    found = [_density(mode, hits, kernels, heights) for mode in modes]
    dense = [k for k, density in enumerate(found) if density > threshold]
    boxes = np.array([_box(modes[k], window) for k in dense], np.int32).reshape(-1, 4)
    return boxes, np.array([found[k] for k in dense], np.float64)


def _kernel_widths(log_scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """Widths of kernels (…, 3) at logarithms of scales."""
    at = np.exp(log_scales)
    return np.stack([_KERNEL[0] * at, _KERNEL[1] * at, np.full_like(at, _KERNEL[2])], axis=-1)


def _density(
    point: NDArray[np.float64], hits: NDArray[np.float64], kernels: NDArray[np.float64], heights: NDArray[np.float64]
) -> float:
    return float(np.sum(heights * np.exp(-np.square((hits - point) / kernels).sum(axis=1) / 2)))


def _shift(
    point: NDArray[np.float64], hits: NDArray[np.float64], kernels: NDArray[np.float64], heights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """One step of the mean shift."""
    near = heights * np.exp(-np.square(hits / kernels - point / kernels).sum(axis=1) / 2)
    total = (near[:, None] / kernels).sum(axis=0)
    with np.errstate(invalid="ignore"):  # NaN, as in OpenCV, if all weights are 0
        shifted: NDArray[np.float64] = (near[:, None] * (hits / kernels)).sum(axis=0) / total
    return shifted


def _climb(
    point: NDArray[np.float64], hits: NDArray[np.float64], kernels: NDArray[np.float64], heights: NDArray[np.float64]
) -> NDArray[np.float64]:
    for _ in range(100):
        before, point = point, _shift(point, hits, kernels, heights)
        if _distance(point, before) <= 1e-5:
            break
    return point


def _distance(point: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Squared distance, in widths of kernels at the other's scale."""
    return float(np.square((other - point) / _kernel_widths(other[2])).sum())


def _box(mode: NDArray[np.float64], window: Size) -> tuple[int, int, int, int]:
    """The rectangle of a mode, rounded towards zero, as OpenCV does."""
    scale = math.exp(mode[2])
    width, height = int(window[0] * scale), int(window[1] * scale)
    return int(mode[0] - width // 2), int(mode[1] - height // 2), width, height


def clip(rectangles: Rectangles, weights: Weights, size: Size) -> tuple[Rectangles, Weights]:
    """Rectangles cut off at the border of an image of (width, height), without those outside it."""
    corner = np.maximum(rectangles[:, :2], 0)
    sides = np.minimum(rectangles[:, :2] + rectangles[:, 2:], size) - corner
    visible = (sides > 0).all(axis=1)
    return np.hstack([corner, sides])[visible].astype(np.int32), weights[visible]
