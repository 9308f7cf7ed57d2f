"""Checks of arguments: types that OpenCV's bindings for Python do not take raise TypeError.

Numbers are Python's or NumPy's scalars, never arrays of one entry; a truth value is not a number.  None is the default.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...inputs.numbers import shortened
from .original import load_original

Size: TypeAlias = tuple[int, int]  # (width, height), as everywhere in OpenCV
Locations: TypeAlias = Sequence[Sequence[int]] | NDArray[np.integer]

# entries of OpenCV's arrays; of the last two, it writes none
_DEPTHS = ["uint8", "int8", "uint16", "int16", "int32", "float16", "float32", "float64", "int64", "uint64"]


def integer(name: str, value: Any, default: int = 0) -> int:
    """An integer of 32 bits."""
    value = default if value is None else value
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not -(2**31) <= value < 2**31:
        raise TypeError(f"{name} must be an integer of 32 bits, got {shortened(value)}")
    return int(value)


def number(name: str, value: Any, default: float) -> float:
    """A real number of 64 bits."""
    value = default if value is None else value
    if isinstance(value, bool | np.longdouble) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be a number, got {shortened(value)}")
    try:
        return float(value)
    except OverflowError:
        raise TypeError(f"{name} must be a number of 64 bits, got an integer that is larger") from None


def flag(name: str, value: Any) -> bool:
    """A truth value, or an integer; False by default."""
    if value is not None and not isinstance(value, bool | np.bool_ | int | np.integer):
        raise TypeError(f"{name} must be True or False, got {shortened(value)}")
    return bool(value)


def pair(name: str, value: Any) -> Size:
    """A sequence of two integers, x and y."""
    try:
        across, down = value if isinstance(value, Sequence | np.ndarray) else ()
        return integer(name, across), integer(name, down)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a pair (width, height) of integers, got {shortened(value)}") from None


def text(name: str, value: Any, default: str | None = None) -> str:
    """A string; bytes are decoded as names of files are."""
    value = default if value is None else value
    try:
        return os.fsdecode(value)
    except TypeError:
        raise TypeError(f"{name} must be a string, got {shortened(value)}") from None


def stride(value: Any, default: Size) -> Size:
    """``winStride``; the default for None and (0, 0)."""
    step = default if value is None else pair("winStride", value)
    step = default if step == (0, 0) else step
    if min(step) < 1:
        raise ValueError(f"winStride must be at least 1 along both axes, got {step}")
    return step


def margins(name: str, value: Any) -> tuple[Size, int, int]:
    """Padding (x, y), at least 0, and how many pixels negative numbers leave out along x and along y."""
    across, down = (0, 0) if value is None else pair(name, value)
    return (max(across, 0), max(down, 0)), max(-across, 0), max(-down, 0)


def is_umat(value: Any) -> bool:
    """Whether it is a ``cv2.UMat``, without OpenCV."""
    return type(value).__name__ == "UMat"


def array(name: str, value: Any) -> NDArray[Any]:
    """An array, ``cv2.UMat`` or tuple as OpenCV has it: (rows, cols, channels), or more dimensions unchanged."""
    if is_umat(value):
        if value.isSubmatrix():  # OpenCV also uses the pixels around it, which cannot be read
            raise ValueError(f"{name} must be a whole UMat, got a part of another: pass its get()")
        pixels = value.get()
        value = () if pixels is None else pixels
    if not isinstance(value, np.ndarray | tuple):
        is_array_like = (
            isinstance(value, list) or hasattr(value, "__array__") or hasattr(type(value), "__array_interface__")
        )
        write = f": write np.asarray({name})" if is_array_like else ""
        raise TypeError(f"{name} must be an array, got {type(value).__name__}{write}")
    values = np.atleast_1d(value)
    if values.dtype.name not in _DEPTHS or not values.dtype.isnative:
        raise TypeError(f"{name} must be an array of numbers that OpenCV knows, got {values.dtype}")
    if not getattr(value, "wrap_channels", values.ndim == 3):  # an attribute of cv2.Mat
        values = values[..., None]
    return values[:, None] if values.ndim == 2 else values


def image(img: Any) -> NDArray[np.uint8]:
    """The image with its channels, (rows, cols, channels), contiguous."""
    pixels = array("img", img)
    if pixels.dtype != np.uint8:
        raise TypeError(f"img must be an array of uint8, got {pixels.dtype}: write img.astype(np.uint8) of 0…255")
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or not pixels.size:
        shape = getattr(img, "shape", pixels.shape)
        raise ValueError(f"img must have the shape (rows, cols) or (rows, cols, 1 or 3 channels), got {shape}")
    return np.ascontiguousarray(pixels)


def output(name: str, value: Any, result: Any) -> Any:
    """The result, written to ``value`` if that is an array or ``cv2.UMat`` of the same kind, shape and dtype."""
    if is_umat(value):
        return load_original("copyTo")(result, None, value)
    if not isinstance(value, np.ndarray):
        if value is not None and not isinstance(value, int | float | tuple):
            raise TypeError(f"{name} must be None or an array to write to, got {type(value).__name__}")
        return result
    first = np.atleast_1d(value)[:1]
    if not value.flags.writeable or min(value.strides, default=0) < 0 or not first.flags.c_contiguous:
        raise ValueError(f"{name} must be an array that can be written to row by row, got another layout")
    if value.dtype.name not in _DEPTHS[:8]:
        raise TypeError(f"{name} must be an array of numbers that OpenCV knows, got {value.dtype}")
    if is_umat(result) or (value.shape, value.dtype) != (result.shape, result.dtype):
        return result
    value[...] = result
    return value


def locations(name: str, value: Locations | None) -> NDArray[np.int64] | None:
    """Corners (windows, 2); None for none."""
    if value is None:
        return None
    if not isinstance(value, Sequence | np.ndarray):
        raise TypeError(f"{name} must be a sequence of pairs (x, y), got {type(value).__name__}")
    corners = [(0, 0) if corner is None else pair(f"each of {name}", corner) for corner in value]
    return np.array(corners, np.int64) if corners else None
