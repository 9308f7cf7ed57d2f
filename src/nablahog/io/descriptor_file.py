"""Descriptors on disk: one .npz archive with the descriptor, its spec and the size of its image."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ..hog import HOGSpec
from ..hog.inputs import descriptor_tensor
from ..hog.presets import as_spec
from .files import starts_as
from .npz import check_format, naming, read_arrays, text, write_arrays

FORMAT = 1
_ARRAYS = ("format", "descriptor", "spec", "image_size")


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
        if not isinstance(self.descriptor, Tensor) or self.descriptor.dtype not in (torch.float32, torch.float64):
            raise TypeError("the descriptor must be a tensor of float32 or float64")
        height, width = self.image_size
        if height < 1 or width < 1:
            raise ValueError(f"the image size must be at least 1x1, got {height}x{width}")
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
        if not torch.isfinite(self.descriptor).all():
            raise ValueError("the descriptor must be finite, got NaN or Inf")

    def __repr__(self) -> str:
        """Sizes and spec, not the numbers."""
        shape, size = ("x".join(map(str, sides)) for sides in (self.descriptor.shape, self.image_size))
        return f"<StoredDescriptor {shape}, image {size}, {self.spec!r}>"


def save_descriptor(
    path: str | os.PathLike[str],
    descriptor: Tensor | NDArray[np.floating],
    spec: HOGSpec | str,
    image_size: tuple[int, int],
) -> None:
    """Writes a descriptor (rows, cols, channels) of an image of ``image_size`` (height, width) to the file ``path``.

    The descriptor is a tensor or an array, the spec its dialect, or the name of a preset with its defaults.  The file
    is a compressed .npz archive of the arrays ``descriptor``, ``spec`` (its JSON), ``image_size`` and ``format`` (1),
    for any ending of its name.  It is replaced whole or not at all.

    Args:
        path: of the file, with any ending.
        descriptor: (rows, cols, channels), float32 or float64, finite; of a tensor its values.
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
    if not isinstance(descriptor, Tensor):
        descriptor = descriptor_tensor("the descriptor", descriptor)
    stored = StoredDescriptor(descriptor.detach().cpu(), spec, (int(image_size[0]), int(image_size[1])))
    arrays = {"descriptor": stored.descriptor.numpy(), "spec": spec.to_json(), "image_size": stored.image_size}
    write_arrays(path, FORMAT, arrays, compressed=True)


def load_descriptor(path: str | os.PathLike[str]) -> StoredDescriptor:
    """The descriptor that :func:`save_descriptor` wrote.  Never unpickles, so nothing in the file is ever run.

    Args:
        path: of the file.

    Returns:
        The descriptor (rows, cols, channels) on the CPU, with its spec and the size of its image.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
            descriptor, spec and image size contradict each other.

    >>> spec = nablahog.presets.uoctti()
    >>> nablahog.save_descriptor("image.npz", np.zeros((8, 6, 31), np.float32), spec, (64, 48))
    >>> stored = nablahog.load_descriptor("image.npz")
    >>> stored.descriptor.shape, stored.spec == spec, stored.image_size
    (torch.Size([8, 6, 31]), True, (64, 48))
    """
    arrays = read_arrays(path, "descriptor file", _ARRAYS)
    with naming(path):
        return _checked(arrays)


def is_descriptor_file(path: str | os.PathLike[str]) -> bool:
    """Whether ``path`` claims to be a descriptor file: it is named .npz, or starts as a zip archive does."""
    return starts_as(path, ".npz", b"PK\x03\x04")


def _checked(arrays: dict[str, NDArray[np.generic]]) -> StoredDescriptor:
    check_format(arrays, "descriptor file", FORMAT)
    spec, size, descriptor = HOGSpec.from_json(text(arrays, "spec")), arrays["image_size"], arrays["descriptor"]
    if size.shape != (2,) or size.dtype.kind not in "iu":
        raise ValueError(f"image_size must be two integers (height, width), got {size.dtype} of shape {size.shape}")
    native = np.ascontiguousarray(descriptor, dtype=descriptor.dtype.newbyteorder("="))
    if native.dtype not in (np.float32, np.float64):
        raise ValueError(f"the descriptor must be float32 or float64, got {native.dtype}")
    height, width = size.tolist()
    return StoredDescriptor(torch.from_numpy(native), spec, (height, width))
