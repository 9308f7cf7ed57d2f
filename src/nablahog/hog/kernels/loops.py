"""The native loops on tensors, shared out to threads: by images, or by rows of a single large one."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int32, c_int64, c_void_p
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ... import native
from ...runtime.pytorch import share_out
from ..spec import HOGSpec
from .plan import NormPlan, Plan

_LARGE = 2**16  # pixels of an image that is worth more than one thread
_PIXELS = c_void_p, c_void_p, c_void_p  # plan, images, strides
_RANGE = c_int64, c_int64
_hog = native.function("hog", *_PIXELS, *_RANGE, c_void_p, c_void_p)
_hog_bands = native.function("hog_bands", *_PIXELS, *_RANGE, c_void_p, c_void_p)
_band_size = native.function("band_size", c_void_p, c_void_p)
_join_bands = native.function("join_bands", c_void_p, c_void_p, c_void_p)
_hog_vjp = native.function("hog_vjp", *_PIXELS, *_RANGE, c_void_p, c_void_p, c_void_p)
_hog_vjp_rows = native.function("hog_vjp_rows", *_PIXELS, *_RANGE, c_void_p, c_void_p, c_void_p)
_hog_jvp = native.function("hog_jvp", *_PIXELS, *_RANGE, c_void_p, c_void_p, c_void_p)
_normalize = native.function("normalize", c_void_p, *_RANGE, c_void_p, c_void_p)
_normalize_vjp = native.function("normalize_vjp", c_void_p, *_RANGE, c_void_p, c_void_p, c_void_p)
_normalize_jvp = native.function("normalize_jvp", c_void_p, *_RANGE, c_void_p, c_void_p, c_void_p)

_energy = native.function("long_energy", c_int32, c_void_p, c_int64, c_void_p)


@lru_cache(maxsize=64)
def _strides(*strides: int) -> tuple[Any, int]:
    """An array of C with these numbers, and its address."""
    array = (c_int64 * 4)(*strides)
    return array, ctypes.addressof(array)


class _Operator:
    """The loops of a dialect, for images (channels, height, width) of one dtype.

    Attributes:
        for_derivatives: the same of the dialect whose derivative is meant: itself, unless ``spec.derivative`` says
            otherwise.
    """

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> None:
        channels, height, width = shape
        self.plan = Plan(spec, (channels, height, width), stored)
        self.shape, self.height, self.bands = shape, height, int(self.plan.struct.rows.stretches)
        self.large = height * width >= _LARGE
        jumps = spec.vote == "hard" and spec.derivative == "linear"
        self.for_derivatives = _operator(spec.with_linear_votes(), shape, stored) if jumps else self

    def in_rows(self, batch: int) -> bool:
        """Whether threads share out parts of an image, not whole ones."""
        return self.large and batch == 1 and torch.get_num_threads() > 1

    def cells_in_bands(self, pixels: tuple[int, ...], cells: Tensor) -> None:
        """The cells of one image, whose bands are shared out."""
        size = c_int64()
        _band_size(self.plan.address, ctypes.byref(size))
        band_cells, broken = self.plan.empty(self.bands, size.value), np.zeros(self.bands, np.uint8)
        to, flags = band_cells.data_ptr(), broken.ctypes.data

        def work(first: int, last: int) -> None:
            _hog_bands(self.plan.address, *pixels, first, last, to, flags + first)

        share_out(work, self.bands)
        _join_bands(self.plan.address, to, cells.data_ptr())
        if broken.any():
            cells.fill_(torch.nan)

    def vjp_in_rows(self, pixels: tuple[int, ...], grad_cells: Tensor, grad_images: Tensor) -> None:
        """The gradient of one image, whose rows are shared out."""
        broken = np.zeros(self.height, np.uint8)
        grad, to, flags = grad_cells.data_ptr(), grad_images.data_ptr(), broken.ctypes.data

        def work(first: int, last: int) -> None:
            _hog_vjp_rows(self.plan.address, *pixels, first, last, grad, to, flags + first)

        share_out(work, self.height)
        if broken.any():
            grad_images.fill_(torch.nan)


_operator = lru_cache(maxsize=64)(_Operator)


def _of(images: Tensor, spec: HOGSpec) -> tuple[_Operator, tuple[int, int]]:
    """The loops, and where the images and their strides are; of any strides without a copy."""
    operator = _operator(spec, images.shape[1:], images.dtype)
    return operator, (images.data_ptr(), _strides(*images.stride())[1])


def _run(loop: Any, plan: NormPlan, count: int, *tensors: Tensor | None, pixels: tuple[int, ...] = ()) -> None:
    """Runs a loop for all of ``count`` images, shared out to threads."""
    at = plan.address, *pixels
    addresses = [None if tensor is None else tensor.data_ptr() for tensor in tensors]
    share_out(lambda first, last: loop(*at, first, last, *addresses), count)


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    operator, pixels = _of(images, spec)
    out = operator.plan.empty(len(images), *operator.plan.cells)
    if operator.in_rows(len(images)):
        operator.cells_in_bands(pixels, out)
    else:
        _run(_hog, operator.plan, len(images), out, None, pixels=pixels)
    return out


def describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Eq. 1-7: descriptors (B, rows, cols, channels) and, for their derivatives, cells (B, rows, cols, bins)."""
    operator, pixels = _of(images, spec)
    batch, plan = len(images), operator.plan
    cells, out = plan.empty(batch, *plan.cells), plan.empty(batch, *plan.grid)
    if operator.in_rows(batch):
        operator.cells_in_bands(pixels, cells)
        _run(_normalize, plan, 1, cells, out)
    else:
        _run(_hog, plan, batch, cells, out, pixels=pixels)
    return out, cells


def cells_vjp(images: Tensor, grad_cells: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the images from ``grad_cells`` (B, rows, cols, bins)."""
    return _vjp(images, None, grad_cells, spec)


def describe_vjp(images: Tensor, cells: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the images from those of the descriptors."""
    return _vjp(images, cells.contiguous(), grad_output, spec)


def _vjp(images: Tensor, cells: Tensor | None, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    operator, pixels = _of(images, spec)
    operator = operator.for_derivatives
    batch, grad_output = len(images), grad_output.contiguous()
    grad_images = operator.plan.empty(batch, *operator.shape)
    if operator.in_rows(batch):
        grad_cells = grad_output if cells is None else norm_vjp(cells, grad_output, spec)
        operator.vjp_in_rows(pixels, grad_cells, grad_images)
    else:
        _run(_hog_vjp, operator.plan, batch, cells, grad_output, grad_images, pixels=pixels)
    return grad_images


def cells_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, rows, cols, bins) from those of the images."""
    return _jvp(images, tangents, None, spec)


def describe_jvp(images: Tensor, cells: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the descriptors (B, rows, cols, channels) from those of the images."""
    return _jvp(images, tangents, cells.contiguous(), spec)


def _jvp(images: Tensor, tangents: Tensor, cells: Tensor | None, spec: HOGSpec) -> Tensor:
    operator, pixels = _of(images, spec)
    plan = operator.for_derivatives.plan
    out = plan.empty(len(images), *(plan.cells if cells is None else plan.grid))
    _run(_hog_jvp, plan, len(images), tangents.contiguous(), cells, out, pixels=pixels)
    return out


@lru_cache(maxsize=64)
def _norm_plan(spec: HOGSpec, shape: torch.Size, dtype: torch.dtype) -> NormPlan:
    return NormPlan(spec, shape[0], shape[1], dtype)


def _of_cells(cells: Tensor, spec: HOGSpec) -> NormPlan:
    """The loops of the normaliser, for cells (B, rows, cols, bins)."""
    return _norm_plan(spec, cells.shape[1:3], cells.dtype)


def norm(cells: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels) of one colour."""
    plan = _of_cells(cells, spec)
    out = plan.empty(len(cells), *plan.grid)
    _run(_normalize, plan, len(cells), cells.contiguous(), out)
    return out


def norm_vjp(cells: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the cells from ``grad_output`` (B, rows, cols, channels)."""
    out = torch.empty_like(cells, memory_format=torch.contiguous_format)
    _run(_normalize_vjp, _of_cells(cells, spec), len(cells), cells.contiguous(), grad_output.contiguous(), out)
    return out


def norm_jvp(cells: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the descriptors from those of the cells."""
    plan = _of_cells(cells, spec)
    out = plan.empty(len(cells), *plan.grid)
    _run(_normalize_jvp, plan, len(cells), cells.contiguous(), tangents.contiguous(), out)
    return out


def add_energy(values: NDArray[Any], total: float) -> float:
    """``total`` plus the sum of squares of numbers (n,), float32 or float64, in double precision."""
    out = c_double(total)
    _energy(values.dtype == np.float64, values.ctypes.data, len(values), ctypes.byref(out))
    return out.value
