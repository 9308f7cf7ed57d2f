"""Checks of OpenCV's arguments: pairs (x, y), images of bytes, places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Size: TypeAlias = tuple[int, int]  # (width, height), as everywhere in OpenCV
Locations: TypeAlias = Sequence[Sequence[int]] | NDArray[np.integer]


def integer(name: str, value: Any, default: int) -> int:
    """An integer of 32 bits, also of NumPy, but no truth value; the default for None."""
    value = default if value is None else value
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not -(2**31) <= value < 2**31:
        raise TypeError(f"{name} must be an integer of 32 bits, got {value!r}")
    return int(value)


def number(name: str, value: Any, default: float) -> float:
    """A number, also of NumPy, but no truth value; the default for None."""
    value = default if value is None else value
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be a number, got {value!r}")
    return float(value)


def truth(name: str, value: Any) -> bool:
    """True or False, also of NumPy, or an integer; False for None."""
    if value is not None and not isinstance(value, int | np.integer | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def pair(name: str, value: Any) -> Size:
    """A pair (x, y) of integers; 0 in the place of None."""
    try:
        if isinstance(value, Sequence | np.ndarray):
            across, down = (integer(name, each, 0) for each in value)
            return across, down
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} must be a pair (width, height) of integers of 32 bits, got {value!r}")


def stride(value: object, default: Size) -> Size:
    """``winStride``; the default for None and (0, 0)."""
    step = default if value is None else pair("winStride", value)
    step = default if step == (0, 0) else step
    if min(step) < 1:
        raise ValueError(f"winStride must be at least 1 along both axes, got {step}")
    return step


def margins(value: object) -> Size:
    """``padding`` of either axis; negative numbers are 0."""
    across, down = (0, 0) if value is None else pair("padding", value)
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
    pixels = img.reshape(*img.shape, *(1,) * (3 - img.ndim))
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or not pixels.size:
        raise ValueError(f"img must have the shape (rows, cols), or 1 or 3 channels behind, got {img.shape}")
    return np.ascontiguousarray(pixels)


def locations(name: str, value: Locations | None) -> NDArray[np.int64] | None:
    """Corners (windows, 2), each a pair as above, (0, 0) for None; None for none."""
    if value is None:
        return None
    if not isinstance(value, Sequence | np.ndarray):
        raise TypeError(f"{name} must be pairs (x, y) of integers, got {type(value).__name__}")
    corners = [(0, 0) if each is None else pair(name, each) for each in value]
    return np.array(corners, np.int64) if corners else None
