"""The compiled loops on tensors, shared out to threads: by images, or of a single large one by bands of rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

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
        self.bands, self.of_band = (
            len(self.pooling.bands),
            (self.pooling.cols + self.pooling.wide) * self.pooling.of_cell,
        )
        self.channels, self.height, self.width = shape
        plane = self.height * self.width
        self.dense = 0, (self.height, self.width), (self.channels * plane, plane, self.width, 1)
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


_pixels = lru_cache(maxsize=64)(_Pixels)
_norm = lru_cache(maxsize=64)(_Norm)


def _cells(images: Tensor, spec: HOGSpec) -> Any:
    known = _pixels(spec, images.shape[1:], images.dtype)
    plan, batch = (*known.stored(images), *known.plan), len(images)
    found = np.empty((batch, *known.cells), known.real)
    if known.in_bands(batch):
        of_bands, none = np.empty((known.bands, known.of_band), known.real), found[:0]
        share_out(lambda *some: known.run(loop_over_cells, *plan, (0, 1), some, of_bands, none), known.bands)
        known.run(add_bands, of_bands, known.pooling, found[0])
    else:
        every = 0, known.bands

        def work(*some: int) -> None:
            of_band = np.empty((1, known.of_band), known.real)  # each thread's own
            known.run(loop_over_cells, *plan, some, every, of_band, found)

        share_out(work, batch)
    return found


def _cells_back(images: Tensor, reached: Any, spec: HOGSpec) -> Any:
    known = _pixels(_followed(spec), images.shape[1:], images.dtype)
    plan, batch = (*known.stored(images), *known.plan), len(images)
    found = np.empty((batch, known.channels, known.height, known.width), known.real)
    if known.in_bands(batch):
        share_out(lambda *some: known.run(cells_adjoint, *plan, reached, (0, 1), some, found), known.height)
    else:
        rows = 0, known.height
        share_out(lambda *some: known.run(cells_adjoint, *plan, reached, some, rows, found), batch)
    return found


def _normed(cells: Any, spec: HOGSpec) -> Any:
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty((cells.shape[0], *known.grid), cells.dtype)
    share_out(lambda start, stop: known.run(known.loop, cells, known.scheme, start, stop, found), len(cells))
    return found


def _norm_back(cells: Any, reached: Any, spec: HOGSpec) -> Any:
    known = _norm(spec, cells.shape[1:], cells.dtype.type)
    found = np.empty(cells.shape, cells.dtype)
    share_out(lambda start, stop: known.run(known.back, cells, known.scheme, reached, start, stop, found), len(cells))
    return found


def _array(tensor: Tensor) -> Any:
    return tensor.contiguous().numpy()


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    return torch.from_numpy(_cells(images, spec))


def cells_back(images: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint: what reaches the images from ``given`` (B, rows, cols, bins), of the cells."""
    return torch.from_numpy(_cells_back(images, _array(given), spec))


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
    return torch.from_numpy(_normed(_array(histograms), spec))


def norm_back(histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the histograms from ``given`` (B, rows, cols, channels), of the descriptors."""
    return torch.from_numpy(_norm_back(_array(histograms), _array(given), spec))


def describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """All of it: the descriptors, and the cells."""
    histograms = _cells(images, spec)
    return torch.from_numpy(_normed(histograms, spec)), torch.from_numpy(histograms)


def describe_back(images: Tensor, histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the images from ``given``, of the descriptors, whose cells are known."""
    to_cells = _norm_back(_array(histograms), _array(given), spec)
    return torch.from_numpy(_cells_back(images, to_cells, spec))


def _followed(spec: HOGSpec) -> HOGSpec:
    """The dialect whose derivative is meant."""
    return spec.with_linear_votes() if spec.derivative == "linear" else spec
