"""Descriptors on disk: one .npz archive with the descriptor, its spec and the size of its image.

Arrays of other libraries become such descriptors by their layout and the size of their image.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ..hog import HOGSpec
from ..hog.dialects import as_spec
from ..hog.layout import from_layout, native_shape
from ..hog.spec import Layout
from ..inputs.arrays import as_descriptors
from ..inputs.numbers import as_size, check_type
from ..inputs.tensors import check_finite, check_floats, check_values, read_tensor
from .arrays import check_format, is_raw, naming, read_arrays, read_text, write_arrays
from .files import Writable
from .input_file import Readable

FORMAT = 1
_ARRAYS = ("format", "descriptor", "spec", "image_size")
# further layouts of a library, by an argument or one more step
_ALSO: dict[Layout, tuple[Layout, ...]] = {
    "block-vector": ("blocks",),
    "blocks": ("block-vector",),
    "colour-planes": ("planes",),
}
# layouts with rows and columns: the number of axes, and the axis of the rows; the columns are the next axis
_GRIDS: dict[Layout, tuple[int, int]] = {"cells": (3, 0), "planes": (3, 1), "colour-planes": (4, 2), "blocks": (5, 0)}


@dataclass(frozen=True, repr=False)
class StoredDescriptor:
    """A descriptor with all that is needed to invert it.

    Attributes:
        descriptor: (rows, cols, channels), float32 or float64, finite, on the CPU.
        spec: the dialect it was computed in.
        image_size: (height, width) in pixels of the image it was computed from.

    Raises:
        TypeError: the descriptor is no float32 or float64 tensor.
        ValueError: the three contradict each other, or the descriptor is not finite.

    >>> from nablahog.io import StoredDescriptor
    >>> spec = nablahog.presets.paper()
    >>> StoredDescriptor(nablahog.hog(torch.rand(1, 1, 32, 32), spec)[0], spec, (32, 32)).descriptor.shape
    torch.Size([4, 4, 9])
    """

    descriptor: Tensor
    spec: HOGSpec
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        check_floats("the descriptor", self.descriptor)
        check_type("spec", self.spec, HOGSpec, "nablahog.presets.NAME()")
        object.__setattr__(self, "image_size", as_size("image_size", self.image_size))
        height, width = self.image_size
        limit = Image.MAX_IMAGE_PIXELS or math.inf
        if height * width > limit:
            raise ValueError(f"the image size must be at most {limit:,} pixels, got {height}x{width}")
        expected = (*self.spec.grid(height, width), self.spec.channels)
        shape = tuple(self.descriptor.shape)
        if shape != expected:
            raise ValueError(
                f"{self.spec.named} descriptor of an image of {height}x{width} pixels has shape {expected} "
                f"(rows, cols, channels), got {shape}"
            )
        check_finite("the descriptor", self.descriptor)

    def __repr__(self) -> str:
        """Sizes and spec, not the numbers."""
        shape, size = ("x".join(map(str, sides)) for sides in (self.descriptor.shape, self.image_size))
        return f"<StoredDescriptor {shape}, image {size}, {self.spec!r}>"


def save_descriptor(
    path: Writable,
    descriptor: Tensor | NDArray[np.floating],
    spec: HOGSpec | str,
    image_size: tuple[int, int],
) -> None:
    """Writes a descriptor (rows, cols, channels) of an image of ``image_size`` (height, width) to the file ``path``.

    The file is a compressed .npz archive of the arrays ``descriptor``, ``spec`` (its JSON), ``image_size`` and
    ``format`` (1).  It is replaced completely or not at all.

    Args:
        path: the file, with any ending, or a stream.
        descriptor: (rows, cols, channels), a tensor or an array, float32 or float64, finite; of a tensor its values.
        spec: the dialect, or the name of a preset with its defaults.
        image_size: (height, width) in pixels.

    Raises:
        TypeError, ValueError: as :class:`StoredDescriptor`, or there is no such preset; nothing is written.
        OSError: the file cannot be written.

    >>> spec = nablahog.presets.uoctti()
    >>> descriptor = nablahog.hog(np.zeros((64, 48), np.uint8), spec)
    >>> nablahog.save_descriptor("image.npz", descriptor, spec, (64, 48))
    """
    spec = as_spec(spec)
    tensor, is_single = as_descriptors("the descriptor", descriptor)
    check_values("the descriptor", tensor)
    values = (tensor[0] if is_single else tensor).detach().cpu()
    stored = StoredDescriptor(values, spec, image_size)
    array = read_tensor("the descriptor", stored.descriptor)
    arrays = {"descriptor": array, "spec": spec.to_json(), "image_size": stored.image_size}
    write_arrays(path, FORMAT, arrays, compressed=True)


def load_descriptor(path: Readable) -> StoredDescriptor:
    """The descriptor that :func:`save_descriptor` wrote.  Nothing is unpickled, so no code in the file is run.

    Args:
        path: the file, or an :class:`~nablahog.io.input_file.InputFile` of its bytes.

    Returns:
        The descriptor (rows, cols, channels) on the CPU, with its spec and the size of its image.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not such an archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
            descriptor, spec and image size contradict each other.

    >>> spec = nablahog.presets.uoctti()
    >>> nablahog.save_descriptor("image.npz", np.zeros((8, 6, 31), np.float32), spec, (64, 48))
    >>> stored = nablahog.load_descriptor("image.npz")
    >>> stored.descriptor.shape, stored.spec == spec, stored.image_size
    (torch.Size([8, 6, 31]), True, (64, 48))
    """
    if is_raw(path):
        raise ValueError(
            f"{path}: expected a descriptor file of nablahog.save_descriptor, got an array of another program: read it "
            "with numpy.load, or scipy.io.loadmat, and nablahog.which_hog says what it is"
        )
    arrays = read_arrays(path, "descriptor file", _ARRAYS)
    with naming(path):
        return _check_arrays(arrays)


def _check_arrays(arrays: dict[str, NDArray[np.generic]]) -> StoredDescriptor:
    check_format(arrays, "descriptor file", FORMAT)
    spec, size, descriptor = HOGSpec.from_json(read_text(arrays, "spec")), arrays["image_size"], arrays["descriptor"]
    if size.shape != (2,) or size.dtype.kind not in "iu":
        raise ValueError(f"image_size must be two integers (height, width), got {size.dtype} of shape {size.shape}")
    native = np.ascontiguousarray(descriptor, dtype=descriptor.dtype.newbyteorder("="))
    if native.dtype not in (np.float32, np.float64):
        raise ValueError(f"the descriptor must be float32 or float64, got {native.dtype}")
    height, width = size.tolist()
    return StoredDescriptor(torch.from_numpy(native), spec, (height, width))


@dataclass(frozen=True)
class FittedLayout:
    """The layout in which an array is a descriptor, its shape without an axis of a batch, and its image's size."""

    layout: Layout
    shape: tuple[int, ...]
    image_size: tuple[int, int]


def find_layout(shape: tuple[int, ...], spec: HOGSpec, image_size: tuple[int, int] | None) -> FittedLayout | None:
    """The layout in which an array of this shape is a descriptor of ``spec``; None if there is none.

    Tries the layout of the library, the same in one row, and (rows, cols, channels), each also with an axis of a batch
    of one in front; the first that fits counts.  Without an image size the image has whole cells, if the array has rows
    and columns.
    """
    for layout in layouts(spec):
        laid_out = replace(spec, layout=layout)
        for single_shape in _drop_batch_axis(shape):
            try:
                size = image_size or _image_size(single_shape, laid_out)
                expected = () if size is None else native_shape(laid_out, size)
            except ValueError:  # the image would hold no cell
                continue
            in_one_row = layout == spec.layout and single_shape == (math.prod(expected),)
            if size is not None and (single_shape == expected or in_one_row):
                return FittedLayout(layout, single_shape, size)
    return None


def layouts(spec: HOGSpec) -> tuple[Layout, ...]:
    """The layouts of arrays that can be descriptors of ``spec``, the library's own first."""
    return tuple(dict.fromkeys((spec.layout, *_ALSO.get(spec.layout, ()), "cells")))


def shapes(spec: HOGSpec, image_size: tuple[int, int] | None) -> str:
    """The shapes of descriptors of ``spec``, for messages; ValueError if the image is too small for ``spec``."""
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
    """Whether all entries of an array of this shape are in one row, or column."""
    return max(shape, default=0) == math.prod(shape)


def to_descriptor(array: NDArray[np.floating], spec: HOGSpec, how: FittedLayout) -> StoredDescriptor:
    """The descriptor in an array that fits; float16 becomes float32.

    Raises:
        ValueError: it holds NaN or Inf, or the image would be too large.
    """
    kind = np.float64 if array.dtype.itemsize == 8 else np.float32
    native = torch.from_numpy(np.ascontiguousarray(array, dtype=kind)).reshape(1, *how.shape)
    descriptor = from_layout(native, replace(spec, layout=how.layout), how.image_size)[0].contiguous()
    return StoredDescriptor(descriptor, spec, how.image_size)


def _drop_batch_axis(shape: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    yield shape
    if len(shape) > 1 and shape[0] == 1:
        yield shape[1:]
    if len(shape) == 2 and shape[1] == 1:  # a column, as MATLAB and older versions of OpenCV have it
        yield shape[:1]


def _image_size(shape: tuple[int, ...], spec: HOGSpec) -> tuple[int, int] | None:
    axes, first = _GRIDS.get(spec.layout, (-1, 0))
    return spec.image_size(shape[first], shape[first + 1]) if len(shape) == axes else None
