"""The steps as native loops on tensors, shared out to threads: by images, or by rows of a single large one."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int32, c_int64, c_void_p
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ... import native
from ...runtime.pytorch import run_in_threads
from ..engine import REFERENCE, Cells, Describe, Engine, Norm, OutputAndSaved, Step
from ..spec import HOGSpec
from .tables import ImageTables, NormTables, has_normalizer

_PIXELS_FOR_THREADS = 2**16  # pixels of an image that is worth more than one thread
_NOTHING_SAVED = torch.empty(0, device="cpu")  # whatever the default device is
_IMAGES = c_void_p, c_void_p, c_void_p  # tables, images, strides
_RANGE = c_int64, c_int64
_hog = native.function("hog", *_IMAGES, *_RANGE, c_void_p, c_void_p)
_hog_bands = native.function("hog_bands", *_IMAGES, *_RANGE, c_void_p, c_void_p)
_band_size = native.function("band_size", c_void_p, c_void_p)
_join_bands = native.function("join_bands", c_void_p, c_void_p, c_void_p)
_hog_vjp = native.function("hog_vjp", *_IMAGES, *_RANGE, c_void_p, c_void_p, c_void_p)
_hog_vjp_rows = native.function("hog_vjp_rows", *_IMAGES, *_RANGE, c_void_p, c_void_p, c_void_p)
_hog_jvp = native.function("hog_jvp", *_IMAGES, *_RANGE, c_void_p, c_void_p, c_void_p)
_normalize = native.function("normalize", c_void_p, *_RANGE, c_void_p, c_void_p)
_normalize_vjp = native.function("normalize_vjp", c_void_p, *_RANGE, c_void_p, c_void_p, c_void_p)
_normalize_jvp = native.function("normalize_jvp", c_void_p, *_RANGE, c_void_p, c_void_p, c_void_p)
_energy = native.function("long_energy", c_int32, c_void_p, c_int64, c_void_p)


@lru_cache(maxsize=64)
def _strides(*strides: int) -> tuple[Any, int]:
    """An array of C with these numbers, and its address."""
    array = (c_int64 * 4)(*strides)
    return array, ctypes.addressof(array)


class _ImageStep(Step):
    """Images to cells or, if it ``normalizes``, to descriptors.  Images of any strides are read without a copy."""

    normalizes: ClassVar[bool]

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype) -> None:
        super().__init__(spec, shape, stored, real)
        self.converts = stored == torch.uint8 and real == torch.float64  # the loops compute bytes in float32
        self._stored = real if self.converts else stored
        self._channels, self.height, self._width = shape
        self.is_large = self.height * self._width >= _PIXELS_FOR_THREADS

    def _make_tables(self, spec: HOGSpec) -> ImageTables:
        return ImageTables(spec, (self._channels, self.height, self._width), self._stored)

    @cached_property
    def tables(self) -> ImageTables:
        """Made in the first run, where no transform of PyTorch is active."""
        return self._make_tables(self.spec)

    @cached_property
    def derivative_tables(self) -> ImageTables:
        return self.tables if self.derivative_spec is self.spec else self._make_tables(self.derivative_spec)

    def run(self, x: Tensor, saves: bool = True) -> OutputAndSaved:
        """Descriptors and cells, or cells and nothing."""
        x = x.double() / 255 if self.converts else x
        count, tables, normalizes = x.shape[0], self.tables, self.normalizes
        pixels = tables.address, x.data_ptr(), _strides(*x.stride())[1]
        in_bands = self.is_large and count == 1 and torch.get_num_threads() > 1
        cells = descriptors = _NOTHING_SAVED
        if saves or in_bands or not normalizes:
            cells = x.new_empty((count, *tables.cells), dtype=tables.dtype)
        if saves or normalizes:
            size = (count, *tables.grid) if normalizes else (count, 0)
            descriptors = x.new_empty(size, dtype=tables.dtype)
        to_cells, to_descriptors = cells.data_ptr() or None, descriptors.data_ptr() or None
        if in_bands:
            self._fill_in_bands(pixels, cells)
            if normalizes:
                _normalize(tables.address, 0, 1, to_cells, to_descriptors)
        else:
            run_in_threads(_hog, count, pixels, (to_cells, to_descriptors))
        return (descriptors, cells) if normalizes else (cells, descriptors)

    def _fill_in_bands(self, pixels: tuple[int, ...], cells: Tensor) -> None:
        """The cells of one image, whose bands are shared out."""
        size, bands = c_int64(), int(self.tables.struct.rows.stretches)
        _band_size(self.tables.address, ctypes.byref(size))
        band_cells = cells.new_empty((bands, size.value))
        broken = np.zeros(bands, np.uint8)
        run_in_threads(_hog_bands, bands, pixels, (band_cells.data_ptr(), broken.ctypes.data))
        _join_bands(self.tables.address, band_cells.data_ptr(), cells.data_ptr())
        if broken.any():
            cells.fill_(torch.nan)

    def vjp(self, x: Tensor, saved: Tensor, grad_output: Tensor) -> Tensor:
        count, tables, cells, grad = x.shape[0], self.derivative_tables, saved.contiguous(), grad_output.contiguous()
        grad_images = torch.empty_like(x, memory_format=torch.contiguous_format)
        pixels, out = (tables.address, x.data_ptr(), _strides(*x.stride())[1]), grad_images.data_ptr()
        if self.is_large and count == 1 and torch.get_num_threads() > 1:
            if self.normalizes:
                grad_cells = torch.empty_like(cells)
                _normalize_vjp(tables.address, 0, 1, cells.data_ptr(), grad.data_ptr(), grad_cells.data_ptr())
                grad = grad_cells
            broken = np.zeros(self.height, np.uint8)
            run_in_threads(_hog_vjp_rows, self.height, pixels, (grad.data_ptr(), out, broken.ctypes.data))
            if broken.any():
                grad_images.fill_(torch.nan)
        else:
            to_cells = cells.data_ptr() if self.normalizes else None
            run_in_threads(_hog_vjp, count, pixels, (to_cells, grad.data_ptr(), out))
        return grad_images

    def jvp(self, x: Tensor, saved: Tensor, tangent: Tensor) -> Tensor:
        count, tables, cells, tangent = x.shape[0], self.derivative_tables, saved.contiguous(), tangent.contiguous()
        size = tables.grid if self.normalizes else tables.cells
        out = x.new_empty((count, *size), dtype=tables.dtype)
        to_cells = cells.data_ptr() if self.normalizes else None
        pixels = tables.address, x.data_ptr(), _strides(*x.stride())[1]
        run_in_threads(_hog_jvp, count, pixels, (tangent.data_ptr(), to_cells, out.data_ptr()))
        return out


class NativeCells(_ImageStep, Cells):
    """Eq. 1-6."""

    normalizes = False


class NativeDescribe(_ImageStep, Describe):
    """Eq. 1-7."""

    normalizes = True


class NativeNorm(Norm):
    """Eq. 7."""

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype) -> None:
        super().__init__(spec, shape, stored, real)
        self.tables = NormTables(spec, shape[0], shape[1], real)

    def run(self, x: Tensor, saves: bool = True) -> OutputAndSaved:
        cells, descriptors = x.contiguous(), x.new_empty((len(x), *self.tables.grid))
        run_in_threads(_normalize, len(x), (self.tables.address,), (cells.data_ptr(), descriptors.data_ptr()))
        return descriptors, x.new_empty((len(x), 0)) if saves else _NOTHING_SAVED

    def vjp(self, x: Tensor, saved: Tensor, grad_output: Tensor) -> Tensor:
        cells, grad = x.contiguous(), grad_output.contiguous()
        grad_cells = torch.empty_like(cells)
        addresses = cells.data_ptr(), grad.data_ptr(), grad_cells.data_ptr()
        run_in_threads(_normalize_vjp, len(x), (self.tables.address,), addresses)
        return grad_cells

    def jvp(self, x: Tensor, saved: Tensor, tangent: Tensor) -> Tensor:
        cells, tangent = x.contiguous(), tangent.contiguous()
        out = x.new_empty((len(x), *self.tables.grid))
        addresses = cells.data_ptr(), tangent.data_ptr(), out.data_ptr()
        run_in_threads(_normalize_jvp, len(x), (self.tables.address,), addresses)
        return out


NATIVE_ENGINE = Engine(NativeCells, NativeNorm, NativeDescribe)
_CELLS_ALONE = Engine(NativeCells)


def find_loops(spec: HOGSpec) -> Engine:
    """The steps of a dialect that have loops."""
    smoothed_border = spec.mask == "sobel" and spec.border not in ("reflect", "ignore")
    if smoothed_border:
        return REFERENCE
    if has_normalizer(spec.normalizer.kind):
        return NATIVE_ENGINE
    return _CELLS_ALONE if native.available() else REFERENCE


def supports(spec: HOGSpec) -> bool:
    """Whether these loops have all that the dialect needs, except perhaps its normaliser."""
    return find_loops(spec) is not REFERENCE


def add_energy(values: NDArray[Any], total: float) -> float:
    """``total``, of whole blocks of 256, plus the squares of numbers (n,), rounded as in the native normaliser."""
    if not native.available():
        return total + float(np.square(values, dtype=np.float64).sum())
    out = c_double(total)
    _energy(values.dtype == np.float64, values.ctypes.data, len(values), ctypes.byref(out))
    return out.value
