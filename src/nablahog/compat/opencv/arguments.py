"""Checks of OpenCV's arguments: pairs (x, y), images of bytes, places."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from numbers import Real
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Size: TypeAlias = tuple[int, int]  # (width, height), as everywhere in OpenCV
Locations: TypeAlias = Sequence[Sequence[int]] | NDArray[np.integer]


def pair(name: str, value: object) -> Size:
    """A pair (x, y) of integers."""
    try:
        across, down = map(operator.index, value)  # type: ignore[call-overload]
        return across, down
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a pair (width, height) of integers, got {value!r}") from None


def stride(value: object, default: Size) -> Size:
    """``winStride``; the default for None and (0, 0)."""
    step = default if value is None else pair("winStride", value)
    step = default if step == (0, 0) else step
    if min(step) < 1:
        raise ValueError(f"winStride must be at least 1 along both axes, got {step}")
    return step


def margins(name: str, value: object) -> Size:
    """A padding of either axis; negative numbers are 0."""
    across, down = (0, 0) if value is None else pair(name, value)
    return max(across, 0), max(down, 0)


def from_umat(value: Any) -> Any:
    """The array of a ``cv2.UMat``, which may be on a GPU; anything else as it is."""
    return value.get() if type(value).__name__ == "UMat" else value


def image(img: Any) -> NDArray[np.uint8]:
    """The image with its channels, (rows, cols, channels), contiguous."""
    img = from_umat(img)
    if not isinstance(img, np.ndarray) or img.dtype != np.uint8:
        kind = img.dtype if isinstance(img, np.ndarray) else type(img).__name__
        raise TypeError(f"img must be an array of uint8, got {kind}")
    pixels = img[:, :, None] if img.ndim == 2 else img
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or not pixels.size:
        raise ValueError(f"img must have the shape (rows, cols), or 1 or 3 channels behind, got {img.shape}")
    return np.ascontiguousarray(pixels)


def locations(name: str, value: Locations | None) -> NDArray[np.int64] | None:
    """Corners (windows, 2); None for none."""
    if value is None or not len(value):
        return None
    corners = np.asarray(value)
    if corners.dtype.kind not in "iu" or corners.ndim != 2 or corners.shape[1] != 2:
        raise TypeError(f"{name} must be pairs (x, y) of integers, got {corners.dtype} of the shape {corners.shape}")
    return corners.astype(np.int64)


def number(name: str, value: Any) -> float:
    """A real number."""
    if not isinstance(value, Real):
        raise TypeError(f"{name} must be a number, got {value!r}")
    return float(value)
