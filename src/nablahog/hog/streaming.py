"""Descriptors of images that are larger than memory, strip by strip."""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ..inputs.arrays import check_unmasked
from ..inputs.numbers import as_integer
from ..inputs.pil_images import is_pil, pil_pixels
from ..runtime.text import describe_type
from .descriptor import histograms, normalize
from .dialects import as_spec
from .kernels.loops import add_energy
from .spec import HOGSpec
from .steps import spread_nan
from .strips import Strip, Strips

if TYPE_CHECKING:
    from PIL.Image import Image

STRIP_BYTES = 2**28  # bytes of a strip
_SUMMED = 256  # the compiled global normaliser sums so many numbers in their own precision, then in double


class Rows(Protocol):
    """An image that may be anywhere: an array, a mapped file, a data set of HDF5 or Zarr."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C)."""

    @property
    def dtype(self) -> Any:
        """Anything that NumPy takes for a dtype."""

    def __getitem__(self, rows: slice, /) -> Any:
        """Some rows, with a step of 1: what numpy takes for an array."""


class DescriptorStrip(NamedTuple):
    """Rows of a descriptor.

    Attributes:
        rows: which, of the whole descriptor's.
        descriptor: (rows, cols, channels).
    """

    rows: slice
    descriptor: npt.NDArray[Any]


def stream(image: Rows | Image, spec: HOGSpec | str, *, memory: int = STRIP_BYTES) -> Iterator[DescriptorStrip]:
    """Computes the HOG descriptor of an image that is larger than memory, in strips of rows from the top.

    The rows are those of ``hog`` for the whole image, bit by bit: ``np.concatenate([strip.descriptor for strip
    in stream(image, spec)])`` is ``hog(whole, spec)``.  Without native loops for the dialect they are equal up to
    rounding.  A pixel that is not finite makes the strips that read it NaN; ``hog`` makes all rows NaN.

    Neighbouring strips share some rows of the image, as cells share pixels and blocks cells; these are read for both.
    Where one number normalises a whole descriptor, as in Eq. 7, the image is read twice.

    Args:
        image: (H, W) or (H, W, C), uint8 in 0…255, or float32 or float64 in 0…1; of any number of channels (three are
            R, G, B).  A :class:`numpy.memmap`, such as ``np.load(path, mmap_mode="r")``, anything else that has
            ``shape``, ``dtype`` and rows ``[start:stop]``, or a PIL image of any mode, which is described
            upright and over white.
        spec: the dialect, from :mod:`nablahog.presets`, or the name of a preset with its defaults.
        memory: bytes that a strip may take, approximately, including everything it is computed from; but it has at
            least one row.

    Returns:
        Strips of (rows, cols, channels), NumPy arrays of float32, or of float64 for float64 images and for uint8 if
        that is the default dtype of PyTorch.  The image is read lazily.

    Raises:
        TypeError: ``image`` has no shape, dtype and rows, or another dtype.
        ValueError: it has another shape, or is smaller than one cell; it masks some
            pixels; ``memory`` is not a positive integer; there is no such preset; or rows that are read do not have its
            shape.

    >>> image, spec = np.zeros((640, 64), np.uint8), nablahog.presets.uoctti()
    >>> descriptor = np.empty((*spec.grid(640, 64), spec.channels), np.float32)
    >>> for rows, strip in nablahog.stream(image, spec, memory=2**16):
    ...     descriptor[rows] = strip
    >>> np.array_equal(descriptor, nablahog.hog(image, spec))
    True
    """
    spec = as_spec(spec)
    reader = _Reader(pil_pixels("image", image) if is_pil(image) else image, spec)  # type: ignore[arg-type]
    memory = as_integer("memory", memory)
    height, width, _ = reader.shape
    double = reader.stored == np.float64 or (reader.stored == np.uint8 and torch.get_default_dtype() == torch.float64)
    strips = Strips(spec, height, width, torch.float64 if double else torch.float32)
    rows = memory // _bytes_of_row(spec, reader, 8 if double else 4)
    return _strips(reader, spec, list(strips.split(max((rows - strips.margin) // strips.row_distance, 1))))


class _Reader:
    """Reads rows of an image whose shape and dtype were checked.

    Attributes:
        shape: (H, W, C).
        stored: the dtype, in this machine's order of bytes.
    """

    def __init__(self, image: Any, spec: HOGSpec) -> None:
        try:
            shape, dtype = tuple(int(n) for n in image.shape), np.dtype(image.dtype)
        except (AttributeError, TypeError):
            came = describe_type(image, "np.load(path, mmap_mode='r') or PIL.Image.open(path)", "one call for each")
            raise TypeError(
                f"image must be an array, or have a shape, a NumPy dtype and rows [start:stop], got {came}"
            ) from None
        self.stored: np.dtype[Any] = dtype.newbyteorder("=")
        if self.stored not in (np.uint8, np.float32, np.float64):
            raise TypeError(f"image must be float32 or float64 in 0…1, or uint8 in 0…255, got {dtype}")
        if len(shape) not in (2, 3) or 0 in shape[2:]:
            raise ValueError(f"image must have shape (H, W) or (H, W, C) with at least one channel, got {shape}")
        self._image, self._shape = image, shape
        self.shape = (*shape[:2], *(shape[2:] or (1,)))
        spec.check_channels(self.shape[2])

    def __call__(self, start: int, stop: int) -> Tensor:
        """Rows ``start`` … ``stop`` - 1, (1, C, rows, W)."""
        read = self._image[start:stop]
        check_unmasked("image", read)
        part = np.array(read)
        if part.shape != (stop - start, *self._shape[1:]) or part.dtype.newbyteorder("=") != self.stored:
            raise ValueError(
                f"rows {start} … {stop - 1} of an image of shape {self._shape} and dtype {self.stored} came with shape "
                f"{part.shape} and dtype {part.dtype}"
            )
        _release_pages(self._image)
        rows = torch.from_numpy(part.astype(self.stored, copy=False).reshape(stop - start, *self.shape[1:]))
        return rows.permute(2, 0, 1).unsqueeze(0)


def _release_pages(image: object) -> None:
    """Releases the pages of a mapped file, which otherwise count as this process's memory."""
    mapped = getattr(image, "_mmap", None)
    if isinstance(image, np.memmap) and image.mode == "r" and mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def _bytes_of_row(spec: HOGSpec, reader: _Reader, size: int) -> int:
    """Rough number of bytes for a row of pixels, its histograms and descriptor; numbers have ``size`` bytes."""
    height, width, channels = reader.shape
    (cell_rows, cell_cols), (rows, cols) = spec.cells(height, width), spec.grid(height, width)
    # twice: the pages of a mapped file, too
    read = width * (2 * channels + (spec.colours if spec.colours > 1 else 0)) * reader.stored.itemsize
    converted = width * channels * size if reader.stored == np.uint8 and size == 8 else 0
    # four copies of histograms: two rows of cells for each band, those of the image, and those in a row
    histograms = 4 * math.ceil(cell_rows * cell_cols * spec.colours * spec.bins * size / height)
    return read + converted + histograms + 2 * math.ceil(rows * cols * spec.channels * size / height)


def _strips(reader: _Reader, spec: HOGSpec, strips: list[Strip]) -> Iterator[DescriptorStrip]:
    def cells(pixels: Tensor, strip: Strip) -> Tensor:
        """(1, colours · bins, rows, cols)"""
        return histograms(pixels, spec)[:, :, slice(*strip.cells)]

    scale = None
    if spec.normalizer.reach() is None:
        scale = _scale((cells(reader(*strip.pixels), strip) for strip in strips), spec)
    for strip in strips:
        pixels = reader(*strip.pixels)
        descriptor = cells(pixels, strip)
        descriptor = normalize(descriptor, spec) if scale is None else descriptor * scale.to(descriptor)
        descriptor = spread_nan(descriptor, pixels)
        first, last = strip.rows
        rows = descriptor[0, :, strip.before : strip.before + last - first]
        yield DescriptorStrip(slice(first, last), rows.permute(1, 2, 0).contiguous().numpy())


def _scale(strips: Iterator[Tensor], spec: HOGSpec) -> Tensor:
    """Factors by which the normaliser multiplies the histograms of an image, (colours · bins, 1, 1) in float64.

    Energies are rounded as in the native loops: ``native/per_cell_norm.h``.
    """
    energies = [_Energy() for _ in range(spec.colours)]
    for strip in strips:
        colours = strip.reshape(spec.colours, spec.bins, *strip.shape[2:]).permute(0, 2, 3, 1)
        for energy, cells in zip(energies, colours, strict=True):
            energy.add(cells.contiguous().numpy().reshape(-1))
    factors = []
    for energy in energies:
        factors += [spec.normalizer.image_factor(energy.total())] * spec.bins
    return torch.tensor(factors, dtype=torch.float64, device="cpu").reshape(-1, 1, 1)


class _Energy:
    """The sum of squares of numbers that come a few at a time, rounded as if all came at once."""

    def __init__(self) -> None:
        self._total = 0.0
        self._rest: npt.NDArray[Any] | None = None

    def add(self, values: npt.NDArray[Any]) -> None:
        """More numbers (n,)."""
        values = values if self._rest is None else np.concatenate([self._rest, values])
        whole = len(values) // _SUMMED * _SUMMED
        self._total = add_energy(values[:whole], self._total)
        self._rest = values[whole:].copy()

    def total(self) -> float:
        """The sum of everything so far."""
        return self._total if self._rest is None else add_energy(self._rest, self._total)
