"""Images as arrays of other types, layouts, shapes and containers; the plain one is (H, W), float32 in 0…1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from ..table import Kind, Row, rows

HALF = 2e-3  # roundings of float16


def through(dtype: Any) -> Callable[[Any], Any]:
    return lambda x: x.astype(dtype)


class Holder:
    """What becomes an array, as tables and arrays of other libraries do."""

    def __init__(self, array: Any) -> None:
        self.array = array

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(self.array, dtype=dtype)


class Labelled(np.ndarray):  # type: ignore[type-arg]
    """A subclass of arrays."""


def levels(x: Any, white: int = 255) -> Any:
    return np.rint(np.asarray(x, np.float64) * white)


def read_only(x: Any) -> Any:
    x = x.copy()
    x.flags.writeable = False
    return x


def odd_strides(x: Any) -> Any:
    """The field of records of five bytes."""
    records = np.zeros(x.shape, np.dtype([("pad", "u1"), ("x", x.dtype)]))
    records["x"] = x
    return records["x"]


def flipped(x: Any) -> Any:
    return np.ascontiguousarray(x[::-1, ::-1])[::-1, ::-1]


def spaced(x: Any) -> Any:
    """Every second entry of a wider array."""
    return np.repeat(x, 2, axis=-1)[..., ::2]


def masked(x: Any, some: bool) -> Any:
    mask = np.zeros(x.shape, bool)
    mask[0, 0] = some
    return np.ma.masked_array(x, mask)


def with_pixel(value: float) -> Callable[[Any], Any]:
    def make(x: Any) -> Any:
        x = x.copy()
        x[3, 4] = value
        return x

    return make


def with_channels(count: int) -> Callable[[Any], Any]:
    """As many alike, and a white one."""
    return lambda x: np.stack([x] * count + [np.ones_like(x)], -1)


def binary(x: Any) -> Any:
    return (np.asarray(x) > 0.5).astype(np.float32)


ANY_CHANNELS = {"stream": "takes any number of channels"}
AS_SKIMAGE = {"compat.skimage": "takes what scikit-image takes, by the same rule"}
ONLY_BYTES = {"compat.opencv": "images of OpenCV are uint8"}
A: Kind = "image"

IMAGE_DTYPES = [
    Row("array uint8", A, lambda x: levels(x).astype(np.uint8), must="be taken", leaves_out=AS_SKIMAGE),
    Row("array uint16", A, lambda x: levels(x, 65535).astype(np.uint16), leaves_out=AS_SKIMAGE),
    Row("array int64", A, lambda x: levels(x).astype(np.int64), leaves_out=AS_SKIMAGE),
    Row(
        "array int8",
        A,
        lambda x: levels(x, 127).astype(np.int8),
        means=lambda x: levels(x, 127).astype(np.float32) / 127,
        leaves_out=AS_SKIMAGE,
    ),
    Row("array bool", A, lambda x: binary(x) > 0, means=binary, leaves_out=AS_SKIMAGE),
    Row(
        "array float16", A, through(np.float16), means=lambda x: x.astype(np.float16).astype(np.float32), tolerance=HALF
    ),
    Row("array float64", A, through(np.float64), tolerance=1e-5, must="be taken", leaves_out=ONLY_BYTES),
    Row("array longdouble", A, through(np.longdouble), tolerance=1e-5),
    Row("array big-endian", A, through(">f4"), must="be taken", leaves_out=ONLY_BYTES),
    Row("array complex", A, through(np.complex64), must="be refused"),
    Row("array of objects", A, through(object)),
    Row("array of strings", A, through(str), must="be refused", leaves_out=AS_SKIMAGE),
    Row("array of dates", A, lambda x: levels(x).astype("m8[s]"), must="be refused", leaves_out=AS_SKIMAGE),
]
IMAGE_LAYOUTS = {
    "read-only": read_only,
    "negative strides": flipped,
    "odd strides": odd_strides,
    "every second column": spaced,
    "Fortran order": np.asfortranarray,
    "of a subclass": lambda x: x.view(Labelled),
    "masked nowhere": lambda x: masked(x, False),
}
IMAGE_SHAPES = [
    Row("array masked somewhere", A, lambda x: masked(x, True), must="be refused", leaves_out=AS_SKIMAGE),
    Row("array (H, W, 1)", A, lambda x: x[..., None], leaves_out={"compat.skimage": "has channel_axis"}),
    Row("array (1, H, W)", A, lambda x: x[None]),
    Row("array (1, H, W, 1)", A, lambda x: x[None, ..., None]),
    Row("array (3, H, W)", A, lambda x: np.stack([x, x, x])),
    Row("array (H, W, 4)", A, with_channels(3), warns=True, leaves_out=ANY_CHANNELS),
    Row("array (H, W, 2)", A, with_channels(1), leaves_out=ANY_CHANNELS),
    Row("array (0, W)", A, lambda x: x[:0], must="be refused"),
    Row("array ()", A, lambda x: x[0, 0], must="be refused"),
    Row("array (W,)", A, lambda x: x[0], must="be refused"),
    Row(
        "array in 0…255",
        A,
        lambda x: x * 255,
        warns=True,
        leaves_out={**AS_SKIMAGE, "stream": "does not read all of an image before it describes it"},
    ),
    Row("array below 0", A, lambda x: x - 0.5, means=lambda x: x - 0.5),
    Row("array with NaN", A, with_pixel(np.nan), means=with_pixel(np.nan), leaves_out=ONLY_BYTES),
    Row("array with infinity", A, with_pixel(np.inf), means=with_pixel(np.inf), leaves_out=ONLY_BYTES | AS_SKIMAGE),
]
IMAGE_CONTAINERS = {
    "list of rows": lambda x: x.tolist(),
    "tuple of arrays": tuple,
    "list of one array": lambda x: [x],
    "list of one uint8 array": lambda x: [levels(x).astype(np.uint8)],
    "what becomes an array": Holder,
    "memoryview": memoryview,
    "tensor (H, W)": torch.from_numpy,
    "tensor (1, H, W)": lambda x: torch.from_numpy(x)[None],
    "tensor (1, 1, H, W)": lambda x: torch.from_numpy(x)[None, None],
    "tensor (1, H, W) uint8": lambda x: torch.from_numpy(levels(x).astype(np.uint8))[None],
    "tensor (H, W) requires_grad": lambda x: torch.from_numpy(x.copy()).requires_grad_(),
    "tensor (1, H, W) requires_grad": lambda x: torch.from_numpy(x.copy())[None].requires_grad_(),
}
NO_IMAGES = [
    Row(
        f"no image: {name}",
        A,
        lambda _, value=value: value,
        must="be refused",
        leaves_out={"reconstruct": "no expected image"} if value is None else {},
    )
    for name, value in {
        "None": None,
        "a number": 3.5,
        "a path": "photo.png",
        "bytes": b"\x89PNG",
        "a dict": {"a": 1},
        "a set": {1, 2},
        "an empty list": [],
        "a function": len,
    }.items()
]


ROWS = [
    *IMAGE_DTYPES,
    *rows(A, IMAGE_LAYOUTS, prefix="array", must="be taken", leaves_out=ONLY_BYTES),
    *IMAGE_SHAPES,
    *[Row(name, A, make) for name, make in IMAGE_CONTAINERS.items()],
    *NO_IMAGES,
]
