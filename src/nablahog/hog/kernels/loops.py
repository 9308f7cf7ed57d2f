"""The compiled loops on tensors, shared out to threads: by images, or of a single large one by bands of rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from ...runtime.threads import share_out
from ..spec import HOGSpec
from . import parameters
from .cells import add_bands, cells_of_images
from .cells_jvp import cells_jvp_of_images
from .cells_vjp import cells_vjp_of_images

Work: TypeAlias = Callable[[int, int], None]
"""Goes over some images, from the first to the one behind the last."""

_LARGE = 2**16  # pixels of an image that is worth more than one thread


class TypedKernelCache:
    """Loops that are called with arguments of always the same types, found once for these."""

    def __init__(self) -> None:
        self._found: dict[Any, Callable[..., None]] = {}

    def run(self, loop: Any, *arguments: Any) -> None:
        found = self._found.get(loop)
        if found is None:
            found = self._found[loop] = loop.for_types_of(*arguments)
        found(*arguments)


class _Norm(TypedKernelCache):
    """What the loops over cells need to know of a dialect and grids of a size."""

    def __init__(self, spec: HOGSpec, shape: tuple[int, ...], real: Any) -> None:
        super().__init__()
        normalizer = spec.normalizer
        if normalizer.has_loops:
            self.loop, self.vjp, self.scheme = normalizer.loops(spec.bins, spec.signed, real)
        rows, cols = (normalizer.footprint(axis).count(shape[axis]) for axis in (0, 1))
        self.grid = rows, cols, spec.channels

    def of_cells(self, cells: Any, found: Any) -> Work:
        """From some images' cells to their descriptors, ``found``."""
        return lambda start, stop: self.run(self.loop, cells, self.scheme, start, stop, found)

    def vjp_of_cells(self, cells: Any, reached: Any, found: Any) -> Work:
        """From what reaches some images' descriptors to what reaches their cells, ``found``."""
        return lambda start, stop: self.run(self.vjp, cells, self.scheme, reached, start, stop, found)


_norm = lru_cache(maxsize=64)(_Norm)


class _Pixels(TypedKernelCache):
    """What the loops over pixels need to know of a dialect and images of a size.

    Attributes:
        norm: what those over their cells need to know.
        followed: the same of the dialect whose derivative is meant.
    """

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> None:
        super().__init__()
        spec.grid(*shape[1:])  # or it is too small
        double = stored == torch.float64
        self.real: Any = np.float64 if double else np.float32
        self.pooling = parameters.pooling(spec, shape[1], shape[2], torch.float64 if double else torch.float32)
        self.reading = parameters.reading(spec, shape[0], shape[1], shape[2], stored)
        self.plan = self.reading, parameters.voting(spec, self.real), self.pooling
        self.cells = self.pooling.rows, self.pooling.cols, self.pooling.bins
        self.norm = _norm(spec, self.cells, self.real)
        self.followed = self if spec.derivative != "linear" else _pixels(spec.with_linear_votes(), shape, stored)
        self.bands = len(self.pooling.bands)
        self.every_band = 0, self.bands
        self.of_band = (self.pooling.cols + self.pooling.wide) * self.pooling.of_cell
        self.shape = channels, self.height, self.width = tuple(shape)
        plane = self.height * self.width
        self.dense = 0, (self.height, self.width), (channels * plane, plane, self.width, 1)
        self.large = plane >= _LARGE

    def stored(self, images: Tensor) -> tuple[Any, int, tuple[int, int], tuple[int, ...]]:
        """The values in memory, wherever each lies: of any strides without a copy."""
        if images.is_contiguous():
            return images.numpy().reshape(-1), *self.dense
        strides = images.stride()
        span = 1 + sum((n - 1) * step for n, step in zip(images.shape, strides, strict=True))
        return images.as_strided((span,), (1,)).numpy(), 0, (self.height, self.width), strides

    def in_bands(self, batch: int) -> bool:
        """Whether threads share out parts of an image, not whole ones."""
        return self.large and batch == 1 and torch.get_num_threads() > 1

    def to_cells(self, images: Tensor, found: Any, then: Work) -> None:
        """From images to their cells, ``found``; ``then`` goes on with those of some, while they are near."""
        plan, batch = (*self.stored(images), *self.plan), images.shape[0]
        if self.in_bands(batch):
            of_bands = np.empty((self.bands, self.of_band), self.real)
            share_out(lambda *some: self.run(cells_of_images, *plan, (0, 1), some, of_bands, found[:0]), self.bands)
            self.run(add_bands, of_bands, self.pooling, found[0])
            then(0, 1)
            return

        def work(*some: int) -> None:
            of_band = np.empty((1, self.of_band), self.real)  # each thread's own
            self.run(cells_of_images, *plan, some, self.every_band, of_band, found)
            then(*some)

        share_out(work, batch)

    def vjp(self, images: Tensor, first: Work, reached: Any) -> Tensor:
        """From what reaches cells, once ``first`` has found it for some images, to what reaches the images."""
        plan, batch = (*self.stored(images), *self.plan), images.shape[0]
        found = np.empty((batch, *self.shape), self.real)
        if self.in_bands(batch):
            first(0, 1)
            share_out(lambda *some: self.run(cells_vjp_of_images, *plan, reached, (0, 1), some, found), self.height)
            return torch.from_numpy(found)

        def work(*some: int) -> None:
            first(*some)
            self.run(cells_vjp_of_images, *plan, reached, some, (0, self.height), found)

        share_out(work, batch)
        return torch.from_numpy(found)


_pixels = lru_cache(maxsize=64)(_Pixels)


def _nothing(start: int, stop: int) -> None:
    """The work that is none."""


def array(tensor: Tensor) -> Any:
    """Its values, one after the other."""
    return tensor.contiguous().numpy()


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    shape = images.shape
    known = _pixels(spec, shape[1:], images.dtype)
    found = np.empty((shape[0], *known.cells), known.real)
    known.to_cells(images, found, _nothing)
    return torch.from_numpy(found)


def cells_vjp(images: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint: what reaches the images from ``given`` (B, rows, cols, bins), of the cells."""
    return _pixels(spec, images.shape[1:], images.dtype).followed.vjp(images, _nothing, array(given))


def cells_jvp(images: Tensor, changes: Tensor, spec: HOGSpec) -> Tensor:
    """How cells (B, rows, cols, bins) change with ``changes`` of the images."""
    known = _pixels(spec, images.shape[1:], images.dtype).followed
    beyond = known.reading._replace(beyond=known.reading.beyond * 0)
    plan = *known.stored(images), array(changes), known.reading, beyond, *known.plan[1:]
    found = np.empty((images.shape[0], *known.cells), known.real)
    share_out(lambda start, stop: known.run(cells_jvp_of_images, *plan, start, stop, found), len(found))
    return torch.from_numpy(found)


def norm(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels) of one colour."""
    cells = array(histograms)
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty((len(cells), *known.grid), cells.dtype)
    share_out(known.of_cells(cells, found), len(cells))
    return torch.from_numpy(found)


def norm_vjp(histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the histograms from ``given`` (B, rows, cols, channels), of the descriptors."""
    cells = array(histograms)
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty_like(cells)
    share_out(known.vjp_of_cells(cells, array(given), found), len(cells))
    return torch.from_numpy(found)


def describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Any]:
    """All of it: the descriptors, and an array of the cells."""
    shape = images.shape
    known = _pixels(spec, shape[1:], images.dtype)
    cells = np.empty((shape[0], *known.cells), known.real)
    found = np.empty((shape[0], *known.norm.grid), known.real)
    known.to_cells(images, cells, known.norm.of_cells(cells, found))
    return torch.from_numpy(found), cells


def describe_vjp(images: Tensor, cells: Any, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the images from ``given``, of the descriptors, by an array of the cells."""
    known = _pixels(spec, images.shape[1:], images.dtype)
    reached = np.empty(cells.shape, known.real)
    return known.followed.vjp(images, known.norm.vjp_of_cells(cells, array(given), reached), reached)
