"""The compiled loops on tensors, shared out to threads: by images, or of a single large one by bands of rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from ...threads import share_out
from ..normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm
from ..spec import HOGSpec
from . import plans
from .adjoint import cells_adjoint
from .cells import add_bands
from .cells import cells as loop_over_cells
from .four_blocks import four_block_adjoint, four_block_norm, four_blocks
from .tangent import tangents_of_images
from .vectors import (
    block_adjoint,
    block_norm,
    cell_adjoint,
    cell_norm,
    global_adjoint,
    global_norm,
    rectangles,
)

Work: TypeAlias = Callable[[int, int], None]
"""Goes over some images, from the first to the one behind the last."""

_LARGE = 2**16  # pixels of an image that is worth more than one thread


class _Found:
    """Loops that are called with arguments of always the same types, found once for these."""

    def __init__(self) -> None:
        self._found: dict[Any, Callable[..., None]] = {}

    def run(self, loop: Any, *arguments: Any) -> None:
        found = self._found.get(loop)
        if found is None:
            found = self._found[loop] = loop.for_types_of(*arguments)
        found(*arguments)


class _Pixels(_Found):
    """What the loops over pixels need to know of a dialect and images of a size."""

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> None:
        super().__init__()
        spec.grid(*shape[1:])  # or it is too small
        double = stored == torch.float64
        self.real: Any = np.float64 if double else np.float32
        self.pooling = plans.pooling(spec, shape[1], shape[2], torch.float64 if double else torch.float32)
        self.reading = plans.reading(spec, shape[0], shape[1], shape[2], stored)
        self.plan = self.reading, plans.voting(spec, self.real), self.pooling
        self.cells = self.pooling.rows, self.pooling.cols, self.pooling.bins
        self.bands = len(self.pooling.bands)
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

    def to_cells(self, images: Tensor, found: Any) -> Work:
        """From some whole images to their cells, ``found``."""
        plan, every = (*self.stored(images), *self.plan), (0, self.bands)

        def work(*some: int) -> None:
            of_band = np.empty((1, self.of_band), self.real)  # each thread's own
            self.run(loop_over_cells, *plan, some, every, of_band, found)

        return work

    def back(self, images: Tensor, reached: Any, found: Any) -> Work:
        """From what reaches the cells of some whole images to what reaches the images, ``found``."""
        plan, rows = (*self.stored(images), *self.plan), (0, self.height)
        return lambda *some: self.run(cells_adjoint, *plan, reached, some, rows, found)


class _Norm(_Found):
    """What the loops over cells need to know of a dialect and grids of a size."""

    def __init__(self, spec: HOGSpec, shape: tuple[int, ...], real: Any) -> None:
        super().__init__()
        scheme = spec.normalizer
        self.loop: Any
        self.back: Any
        self.scheme: Any
        if isinstance(scheme, FourBlockNorm):
            self.loop, self.back = four_block_norm, four_block_adjoint
            self.scheme = four_blocks(scheme, spec.bins, spec.signed, real)
        elif isinstance(scheme, BlockNorm):
            self.loop, self.back, self.scheme = block_norm, block_adjoint, rectangles(scheme, real)
        elif isinstance(scheme, CellNorm):
            self.loop, self.back, self.scheme = cell_norm, cell_adjoint, real(scheme.epsilon)
        else:
            assert isinstance(scheme, GlobalNorm)
            self.loop, self.back = global_norm, global_adjoint
            self.scheme = float(scheme.epsilon), scheme.form == "robust"
        self.grid = (*scheme.grid(*shape[:2]), spec.channels)

    def of_cells(self, cells: Any, found: Any) -> Work:
        """From some images' cells to their descriptors, ``found``."""
        return lambda start, stop: self.run(self.loop, cells, self.scheme, start, stop, found)

    def to_cells(self, cells: Any, reached: Any, found: Any) -> Work:
        """From what reaches some images' descriptors to what reaches their cells, ``found``."""
        return lambda start, stop: self.run(self.back, cells, self.scheme, reached, start, stop, found)


_pixels = lru_cache(maxsize=64)(_Pixels)
_norm = lru_cache(maxsize=64)(_Norm)


def _and_then(first: Work, second: Work) -> Work:
    """Both, of the same images: what the first has found is still near when the second wants it."""

    def work(start: int, stop: int) -> None:
        first(start, stop)
        second(start, stop)

    return work


def _to_cells_in_bands(images: Tensor, known: _Pixels, found: Any) -> None:
    """From a single image to its cells, ``found``."""
    plan, none = (*known.stored(images), *known.plan), found[:0]
    of_bands = np.empty((known.bands, known.of_band), known.real)
    share_out(lambda *some: known.run(loop_over_cells, *plan, (0, 1), some, of_bands, none), known.bands)
    known.run(add_bands, of_bands, known.pooling, found[0])


def _back_in_rows(images: Tensor, known: _Pixels, reached: Any, found: Any) -> None:
    """From what reaches a single image's cells to what reaches it, ``found``."""
    plan = *known.stored(images), *known.plan
    share_out(lambda *some: known.run(cells_adjoint, *plan, reached, (0, 1), some, found), known.height)


def _array(tensor: Tensor) -> Any:
    return tensor.contiguous().numpy()


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    known, batch = _pixels(spec, images.shape[1:], images.dtype), len(images)
    found = np.empty((batch, *known.cells), known.real)
    if known.in_bands(batch):
        _to_cells_in_bands(images, known, found)
    else:
        share_out(known.to_cells(images, found), batch)
    return torch.from_numpy(found)


def cells_back(images: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint: what reaches the images from ``given`` (B, rows, cols, bins), of the cells."""
    known, batch, reached = _pixels(_followed(spec), images.shape[1:], images.dtype), len(images), _array(given)
    found = np.empty((batch, *known.shape), known.real)
    if known.in_bands(batch):
        _back_in_rows(images, known, reached, found)
    else:
        share_out(known.back(images, reached, found), batch)
    return torch.from_numpy(found)


def cells_forward(images: Tensor, changes: Tensor, spec: HOGSpec) -> Tensor:
    """How cells (B, rows, cols, bins) change with ``changes`` of the images."""
    known = _pixels(_followed(spec), images.shape[1:], images.dtype)
    beyond = known.reading._replace(beyond=known.reading.beyond * 0)
    plan = *known.stored(images), _array(changes), known.reading, beyond, *known.plan[1:]
    found = np.empty((images.shape[0], *known.cells), known.real)
    share_out(lambda start, stop: known.run(tangents_of_images, *plan, start, stop, found), len(found))
    return torch.from_numpy(found)


def norm(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels) of one colour."""
    cells = _array(histograms)
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty((len(cells), *known.grid), cells.dtype)
    share_out(known.of_cells(cells, found), len(cells))
    return torch.from_numpy(found)


def norm_back(histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the histograms from ``given`` (B, rows, cols, channels), of the descriptors."""
    cells = _array(histograms)
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty_like(cells)
    share_out(known.to_cells(cells, _array(given), found), len(cells))
    return torch.from_numpy(found)


def describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """All of it: the descriptors, and the cells."""
    known, batch = _pixels(spec, images.shape[1:], images.dtype), len(images)
    norm = _norm(spec, known.cells, known.real)
    histograms, found = np.empty((batch, *known.cells), known.real), np.empty((batch, *norm.grid), known.real)
    if known.in_bands(batch):
        _to_cells_in_bands(images, known, histograms)
        norm.of_cells(histograms, found)(0, batch)
    else:
        share_out(_and_then(known.to_cells(images, histograms), norm.of_cells(histograms, found)), batch)
    return torch.from_numpy(found), torch.from_numpy(histograms)


def describe_back(images: Tensor, histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the images from ``given``, of the descriptors, whose cells are known."""
    known, batch = _pixels(_followed(spec), images.shape[1:], images.dtype), len(images)
    norm, cells = _norm(spec, known.cells, known.real), _array(histograms)
    to_cells, found = np.empty(cells.shape, cells.dtype), np.empty((batch, *known.shape), known.real)
    of_norm = norm.to_cells(cells, _array(given), to_cells)
    if known.in_bands(batch):
        of_norm(0, batch)
        _back_in_rows(images, known, to_cells, found)
    else:
        share_out(_and_then(of_norm, known.back(images, to_cells, found)), batch)
    return torch.from_numpy(found)


def _followed(spec: HOGSpec) -> HOGSpec:
    """The dialect whose derivative is meant."""
    return spec.with_linear_votes() if spec.derivative == "linear" else spec
