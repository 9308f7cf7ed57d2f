"""The compiled loops on tensors, shared out to threads: by images, or by bands of rows of a single large one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from ...runtime.arrays import DType, Flags, Floats
from ...runtime.threads import share_out
from ..spec import HOGSpec
from . import parameters
from .cells import add_bands, cells_of_images, new_band
from .cells_jvp import cells_jvp_of_images, new_band_jvp
from .cells_vjp import cells_vjp_of_images, new_band_vjp
from .finite import find_not_finite
from .parameters import Pixels, Plan

Work: TypeAlias = Callable[[int, int], None]
"""Goes over some images, from the first to the one behind the last."""

_NO_VALUES, _NO_BYTES = np.empty(0, np.float32), np.empty(0, np.uint8)
_LARGE = 2**16  # pixels of an image that is worth more than one thread


class _Workspace(threading.local):
    """The workspace that each thread used last, and may use again: new memory is slow at first."""

    def __init__(self) -> None:
        self._owner: object = None
        self._work: Any = None

    def of(self, owner: object, make: Callable[[], Any]) -> Any:
        """The owner's workspace, made if another one's was used last."""
        if self._owner is not owner:
            self._owner, self._work = owner, make()
        return self._work


_forward, _backward = _Workspace(), _Workspace()


class TypedKernelCache:
    """Caches compiled entry points: each loop is called with arguments of always the same types."""

    def __init__(self) -> None:
        self._entry_points: dict[Any, Callable[..., None]] = {}

    def run(self, loop: Any, *arguments: Any) -> None:
        """Calls ``loop``, a function of :func:`.compile.compiled`; its arguments are of its own types."""
        entry_point = self._entry_points.get(loop)
        if entry_point is None:
            entry_point = self._entry_points[loop] = loop.entry_point(*arguments)
        entry_point(*arguments)


class _Norm(TypedKernelCache):
    """The loops of a dialect's normaliser, for grids of one size."""

    def __init__(self, spec: HOGSpec, shape: tuple[int, ...], dtype: DType) -> None:
        super().__init__()
        normalizer = spec.normalizer
        if normalizer.has_loops:
            self.loop, self.vjp, self.scheme = normalizer.loops(spec.bins, spec.signed, dtype.type)
        rows, cols = (normalizer.footprint(axis).count(shape[axis]) for axis in (0, 1))
        self.grid = rows, cols, spec.channels

    def of_cells(self, cells: Floats, descriptors: Floats) -> Work:
        """The work of normalising ``cells``, to ``descriptors``."""
        return lambda start, stop: self.run(self.loop, cells, self.scheme, start, stop, descriptors)

    def vjp_of_cells(self, cells: Floats, grad_output: Floats, grad_cells: Floats) -> Work:
        """The work of its vjp, to ``grad_cells``."""
        return lambda start, stop: self.run(self.vjp, cells, self.scheme, grad_output, start, stop, grad_cells)


_norm = lru_cache(maxsize=64)(_Norm)


class _Operator(TypedKernelCache):
    """The loops over pixels of a dialect, for images of one size and dtype.

    Attributes:
        norm: the loops over their cells.
        for_vjp: the same of the dialect whose derivative is meant: itself, unless ``spec.derivative`` says otherwise.
    """

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> None:
        super().__init__()
        spec.grid(*shape[1:])  # raises if it is too small
        double = stored == torch.float64
        self.dtype: DType = np.dtype(np.float64 if double else np.float32)
        channels, height, width = shape
        self.shape = channels, height, width
        self.floating = stored.is_floating_point
        pooling = parameters.pooling(spec, height, width, torch.float64 if double else torch.float32)
        reading = parameters.reading(spec, channels, height, width, stored)
        self.plan = Plan(reading, parameters.voting(spec, self.dtype.type), pooling)
        self.cells = pooling.rows, pooling.cols, pooling.bins
        self.cells_size = pooling.rows * pooling.cols * pooling.bins
        self.norm = _norm(spec, self.cells, self.dtype)
        jumps = self.plan.voting.hard and spec.derivative == "linear"
        self.for_vjp = _operator(spec.with_linear_votes(), shape, stored) if jumps else self
        self.bands = len(pooling.bands)
        self.band_size = (pooling.cols + pooling.wide) * pooling.column_size
        self.strides = channels * height * width, height * width, width, 1
        self.large = height * width >= _LARGE

    def pixels(self, images: Tensor) -> Pixels:
        """The stored values, of any strides without a copy."""
        if images.is_contiguous():
            memory, strides = images.numpy().reshape(-1), self.strides
        else:
            batch, channel, row, col = images.stride()
            strides = batch, channel, row, col
            span = 1 + sum((n - 1) * step for n, step in zip(images.shape, strides, strict=True))
            memory = images.as_strided((span,), (1,)).numpy()
        values, stored = (memory, _NO_BYTES) if self.floating else (_NO_VALUES, memory)
        return Pixels(values, stored, *self.shape[1:], strides)

    def _in_bands(self, batch: int) -> bool:
        """Whether threads share out parts of an image, not whole ones."""
        return self.large and batch == 1 and torch.get_num_threads() > 1

    def _find_not_finite(self, pixels: Pixels, images: tuple[int, ...], rows: tuple[int, ...], out: Flags) -> None:
        if self.floating:
            self.run(find_not_finite, pixels, self.shape[0], images, rows, out)

    def _to_cells(
        self, pixels: Pixels, images: tuple[int, ...], bands: tuple[int, ...], band_cells: Floats, cells: Floats
    ) -> None:
        work = _forward.of(self, lambda: new_band(self.plan, pixels.width, self.dtype))
        self.run(cells_of_images, pixels, self.plan, images, bands, work, band_cells, cells)

    def to_cells(self, images: Tensor, cells: Floats, then: Work) -> Flags:
        """From images to ``cells``; ``then`` goes on with the cells of some images while they are in the cache.

        Returns the images (B,) that are not finite, whose cells are NaN.
        """
        pixels, batch, height = self.pixels(images), images.shape[0], self.shape[1]
        flat = cells.reshape(batch, self.cells_size)
        spoilt: Flags = np.zeros(batch, np.bool_)
        if self._in_bands(batch):
            share_out(lambda *rows: self._find_not_finite(pixels, (0, 1), rows, spoilt), height)
            band_cells, none = np.empty((self.bands, self.band_size), self.dtype), flat[:0]
            share_out(lambda *some: self._to_cells(pixels, (0, 1), some, band_cells, none), self.bands)
            self.run(add_bands, band_cells, self.plan.pooling, flat[0])
            then(0, 1)
        else:

            def work(*some: int) -> None:
                band_cells = np.empty((1, self.band_size), self.dtype)  # each thread's own
                self._find_not_finite(pixels, some, (0, height), spoilt)
                self._to_cells(pixels, some, (0, self.bands), band_cells, flat)
                then(*some)

            share_out(work, batch)
        _spoil(cells, spoilt)
        return spoilt

    def vjp(self, images: Tensor, first: Work, grad_cells: Floats) -> Tensor:
        """Gradients of the images from ``grad_cells``, once ``first`` has computed these for some images."""
        pixels, batch, height = self.pixels(images), images.shape[0], self.shape[1]
        grad_images = np.empty((batch, *self.shape), self.dtype)
        of_cells, of_images = grad_cells.reshape(batch, self.cells_size), grad_images.reshape(batch, self.strides[0])
        spoilt: Flags = np.zeros(batch, np.bool_)

        def work(some: tuple[int, ...], rows: tuple[int, ...]) -> None:
            self._find_not_finite(pixels, some, rows, spoilt)
            band = _backward.of(self, lambda: new_band_vjp(self.plan, pixels.width, self.dtype))
            self.run(cells_vjp_of_images, pixels, self.plan, of_cells, some, rows, band, of_images)

        def whole(*some: int) -> None:
            first(*some)
            work(some, (0, height))

        if self._in_bands(batch):
            first(0, 1)
            share_out(lambda *rows: work((0, 1), rows), height)
        else:
            share_out(whole, batch)
        _spoil(grad_images, spoilt)
        return torch.from_numpy(grad_images)

    def jvp(self, images: Tensor, tangents: Floats) -> Tensor:
        """Tangents of the cells from those of the images."""
        reading = self.plan.reading
        reading_jvp = reading._replace(border_value=reading.border_value * 0)
        pixels, out = self.pixels(images), np.empty((len(images), *self.cells), self.dtype)
        flat = out.reshape(len(images), self.cells_size)
        spoilt: Flags = np.zeros(len(images), np.bool_)

        def work(*some: int) -> None:
            self._find_not_finite(pixels, some, (0, self.shape[1]), spoilt)
            band = new_band_jvp(self.plan, pixels.width, self.dtype)
            self.run(cells_jvp_of_images, pixels, tangents, self.plan, reading_jvp, some, band, flat)

        share_out(work, len(out))
        _spoil(out, spoilt)
        return torch.from_numpy(out)


_operator = lru_cache(maxsize=64)(_Operator)


def _spoil(of_images: Floats, spoilt: Flags) -> None:
    """Replaces what belongs to some images (B,) by NaN."""
    if spoilt.any():  # indexing takes longer
        of_images[spoilt] = np.nan


def _nothing(start: int, stop: int) -> None:
    """No work."""


def array(tensor: Tensor) -> Floats:
    """Its values, one after the other."""
    values: Floats = tensor.contiguous().numpy()
    return values


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    shape = images.shape
    operator = _operator(spec, shape[1:], images.dtype)
    out = np.empty((shape[0], *operator.cells), operator.dtype)
    operator.to_cells(images, out, _nothing)
    return torch.from_numpy(out)


def cells_vjp(images: Tensor, grad_cells: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the images from ``grad_cells`` (B, rows, cols, bins)."""
    return _operator(spec, images.shape[1:], images.dtype).for_vjp.vjp(images, _nothing, array(grad_cells))


def cells_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, rows, cols, bins) from those of the images."""
    return _operator(spec, images.shape[1:], images.dtype).for_vjp.jvp(images, array(tangents))


def norm(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels) of one colour."""
    cells = array(histograms)
    loops = _norm(spec, cells.shape[1:], cells.dtype)
    out = np.empty((len(cells), *loops.grid), cells.dtype)
    share_out(loops.of_cells(cells, out), len(cells))
    return torch.from_numpy(out)


def norm_vjp(histograms: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the histograms from ``grad_output`` (B, rows, cols, channels)."""
    cells = array(histograms)
    loops = _norm(spec, cells.shape[1:], cells.dtype)
    grad_cells = np.empty_like(cells)
    share_out(loops.vjp_of_cells(cells, array(grad_output), grad_cells), len(cells))
    return torch.from_numpy(grad_cells)


def describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Floats]:
    """Eq. 1-7: the descriptors, and the cells for the derivatives."""
    shape = images.shape
    operator = _operator(spec, shape[1:], images.dtype)
    cells = np.empty((shape[0], *operator.cells), operator.dtype)
    out = np.empty((shape[0], *operator.norm.grid), operator.dtype)
    spoilt = operator.to_cells(images, cells, operator.norm.of_cells(cells, out))
    _spoil(out, spoilt)
    return torch.from_numpy(out), cells


def describe_vjp(images: Tensor, cells: Floats, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of the images from those of the descriptors."""
    operator = _operator(spec, images.shape[1:], images.dtype)
    grad_cells = np.empty(cells.shape, operator.dtype)
    first = operator.norm.vjp_of_cells(cells, array(grad_output), grad_cells)
    return operator.for_vjp.vjp(images, first, grad_cells)
