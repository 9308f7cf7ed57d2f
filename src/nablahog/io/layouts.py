"""Descriptors as arrays of other libraries: the layout and the image size of an array."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..hog import HOGSpec
from ..hog.layout import from_layout, native_shape
from ..hog.spec import Layout
from .descriptor_file import StoredDescriptor

# further layouts of a library, by an argument or one more step
_ALSO: dict[Layout, tuple[Layout, ...]] = {
    "block-vector": ("blocks",),
    "blocks": ("block-vector",),
    "colour-planes": ("planes",),
}
# layouts with rows and columns: the number of axes, and the axis of the rows; the columns are the next axis
_GRIDS: dict[Layout, tuple[int, int]] = {"cells": (3, 0), "planes": (3, 1), "colour-planes": (4, 2), "blocks": (5, 0)}


@dataclass(frozen=True)
class Fit:
    """The layout in which an array is a descriptor of a spec.

    Attributes:
        layout: its layout.
        shape: its shape, without the axis of a batch of one.
        image_size: (height, width) of the image in pixels.
    """

    layout: Layout
    shape: tuple[int, ...]
    image_size: tuple[int, int]


def fit(shape: tuple[int, ...], spec: HOGSpec, image_size: tuple[int, int] | None) -> Fit | None:
    """The layout in which an array of this shape is a descriptor of ``spec``; None if there is none.

    Tries the layout of the library, the same in one row, and (rows, cols, channels); the first that fits counts.

    Args:
        shape: of the array, perhaps with an axis of a batch of one in front.
        spec: the dialect.
        image_size: (height, width) of the image; None for one of whole cells, if the array has rows and columns.
    """
    for layout in layouts(spec):
        laid_out = replace(spec, layout=layout)
        for each in _without_batch(shape):
            try:
                size = image_size or _image_size(each, laid_out)
                expected = () if size is None else native_shape(laid_out, size)
            except ValueError:  # the image would hold no cell
                continue
            in_one_row = layout == spec.layout and each == (math.prod(expected),)
            if size is not None and (each == expected or in_one_row):
                return Fit(layout, each, size)
    return None


def layouts(spec: HOGSpec) -> tuple[Layout, ...]:
    """The layouts of arrays that can be descriptors of ``spec``, the library's own first."""
    return tuple(dict.fromkeys((spec.layout, *_ALSO.get(spec.layout, ()), "cells")))


def shapes(spec: HOGSpec, image_size: tuple[int, int] | None) -> str:
    """Describes the shapes of such arrays, for error messages.

    Raises:
        ValueError: the image is too small for ``spec``.
    """
    descriptions = []
    for layout in layouts(spec):
        laid_out = replace(spec, layout=layout)
        if image_size is not None:
            descriptions.append(str(native_shape(laid_out, image_size)))
        elif layout in _GRIDS:
            first = _GRIDS[layout][1]
            names = list(map(str, native_shape(laid_out, spec.image_size(1, 1))))
            names[first : first + 2] = "rows", "cols"
            descriptions.append(f"({', '.join(names)})")
    return " or ".join(dict.fromkeys(descriptions))


def is_row(shape: tuple[int, ...]) -> bool:
    """Whether all entries of such an array are in one row, or column."""
    return max(shape, default=0) == math.prod(shape)


def stored(array: NDArray[np.floating], spec: HOGSpec, how: Fit) -> StoredDescriptor:
    """The descriptor that an array is; float16 becomes float32.

    Raises:
        ValueError: it holds NaN or Inf, or the image would be too large.
    """
    kind = np.float64 if array.dtype.itemsize == 8 else np.float32
    native = torch.from_numpy(np.ascontiguousarray(array, dtype=kind)).reshape(1, *how.shape)
    descriptor = from_layout(native, replace(spec, layout=how.layout), how.image_size)[0].contiguous()
    return StoredDescriptor(descriptor, spec, how.image_size)


def _without_batch(shape: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    yield shape
    if len(shape) > 1 and shape[0] == 1:
        yield shape[1:]
    if len(shape) == 2 and shape[1] == 1:  # a column, as MATLAB and older versions of OpenCV have it
        yield shape[:1]


def _image_size(shape: tuple[int, ...], spec: HOGSpec) -> tuple[int, int] | None:
    axes, first = _GRIDS.get(spec.layout, (-1, 0))
    return spec.image_size(shape[first], shape[first + 1]) if len(shape) == axes else None
