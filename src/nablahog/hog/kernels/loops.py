"""The compiled loops on tensors, shared out to threads: by images, or of a single large one by bands of rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...threads import in_threads
from ..normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm
from ..spec import HOGSpec
from . import plans
from .adjoint import adjoints_of_images, cells_adjoint
from .cells import add_bands, cells_of_bands, cells_of_images
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


def _plan(images: Tensor, spec: HOGSpec) -> tuple[Any, ...]:
    """What the loops over pixels begin with: the stored values (…,), where they are, and the plans."""
    return *_stored(images), *_plans(spec, images.shape[1:], images.dtype)


def _stored(images: Tensor) -> tuple[Any, int, tuple[int, int], tuple[int, ...]]:
    """The values in memory, wherever each lies: of any strides without a copy."""
    shape, strides = images.shape, images.stride()
    span = 1 + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    return images.as_strided((span,), (1,)).numpy(), 0, (shape[2], shape[3]), strides


@lru_cache(maxsize=64)
def _plans(spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> tuple[Any, Any, Any]:
    dtype = torch.float64 if stored == torch.float64 else torch.float32
    real = np.float64 if dtype == torch.float64 else np.float32
    return (
        plans.reading(spec, shape[0], shape[1], shape[2], stored),
        plans.voting(spec, real),
        plans.pooling(spec, shape[1], shape[2], dtype),
    )


def _parts(count: int) -> list[tuple[int, int]]:
    """``count`` things in a row, as equal parts as threads."""
    threads = min(torch.get_num_threads(), count)
    ends = [count * k // threads for k in range(threads + 1)]
    return list(pairwise(ends))


def _share_out(work: Callable[[int, int], None], count: int) -> None:
    if torch.get_num_threads() == 1 or count == 1:
        work(0, count)
        return
    parts = _parts(count)
    in_threads(lambda k: work(*parts[k]), len(parts))


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    plan = _plan(images, spec)
    pooling = plan[-1]
    dtype = torch.float64 if images.dtype == torch.float64 else torch.float32
    found = torch.empty((images.shape[0], pooling.rows, pooling.cols, pooling.bins), dtype=dtype)
    array = found.numpy()
    if images.shape[0] == 1 and images.shape[2] * images.shape[3] >= _LARGE and torch.get_num_threads() > 1:
        of_bands = np.empty((len(pooling.bands), (pooling.cols + pooling.wide) * pooling.of_cell), array.dtype)
        _share_out(lambda start, stop: cells_of_bands(*plan, start, stop, of_bands), len(of_bands))
        add_bands(of_bands, pooling, array[0])
    elif images.shape[0] > 0:
        _share_out(lambda start, stop: cells_of_images(*plan, start, stop, array), images.shape[0])
    return found


def cells_back(images: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint: what reaches the images from ``given`` (B, rows, cols, bins), of the cells."""
    plan, reached = _plan(images, _followed(spec)), given.contiguous().numpy()
    found = torch.empty(images.shape, dtype=given.dtype)
    array = found.numpy()
    if images.shape[0] == 1 and images.shape[2] * images.shape[3] >= _LARGE and torch.get_num_threads() > 1:
        one = array[0]
        _share_out(lambda start, stop: cells_adjoint(*plan, reached[0], start, stop, one), images.shape[2])
    elif images.shape[0] > 0:
        _share_out(lambda start, stop: adjoints_of_images(*plan, reached, start, stop, array), images.shape[0])
    return found


def cells_forward(images: Tensor, changes: Tensor, spec: HOGSpec) -> Tensor:
    """How cells (B, rows, cols, bins) change with ``changes`` of the images."""
    stored = _stored(images)
    reading, voting, pooling = _plans(_followed(spec), images.shape[1:], images.dtype)
    beyond = reading._replace(beyond=reading.beyond * 0)
    found = torch.empty((images.shape[0], pooling.rows, pooling.cols, pooling.bins), dtype=changes.dtype)
    array, moved = found.numpy(), changes.contiguous().numpy()

    def work(start: int, stop: int) -> None:
        tangents_of_images(*stored, moved, reading, beyond, voting, pooling, start, stop, array)

    if images.shape[0] > 0:
        _share_out(work, images.shape[0])
    return found


def _followed(spec: HOGSpec) -> HOGSpec:
    """The dialect whose derivative is meant."""
    return spec.with_linear_votes() if spec.derivative == "linear" else spec


@lru_cache(maxsize=64)
def _norm(spec: HOGSpec, single: bool) -> tuple[Callable[..., None], Callable[..., None], Any]:
    """The loop of the dialect's normaliser, its adjoint, and what both need to know."""
    scheme, real = spec.normalizer, np.float32 if single else np.float64
    if isinstance(scheme, FourBlockNorm):
        return four_block_norm, four_block_adjoint, four_blocks(scheme, spec.bins, spec.signed, real)
    if isinstance(scheme, BlockNorm):
        return block_norm, block_adjoint, rectangles(scheme, real)
    if isinstance(scheme, CellNorm):
        return cell_norm, cell_adjoint, real(scheme.epsilon)
    assert isinstance(scheme, GlobalNorm)
    return global_norm, global_adjoint, (float(scheme.epsilon), scheme.form == "robust")


def norm(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels) of one colour."""
    array = histograms.contiguous().numpy()
    loop, _, scheme = _norm(spec, array.itemsize == 4)
    grid = spec.normalizer.grid(*array.shape[1:3])
    found = torch.empty((array.shape[0], *grid, spec.channels), dtype=histograms.dtype)
    to = found.numpy()
    if len(array) > 0:
        _share_out(lambda start, stop: loop(array, scheme, start, stop, to), len(array))
    return found


def norm_back(histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the histograms from ``given`` (B, rows, cols, channels), of the descriptors."""
    array, reached = histograms.contiguous().numpy(), given.contiguous().numpy()
    _, loop, scheme = _norm(spec, array.itemsize == 4)
    found = torch.empty(array.shape, dtype=histograms.dtype)
    to = found.numpy()
    if len(array) > 0:
        _share_out(lambda start, stop: loop(array, scheme, reached, start, stop, to), len(array))
    return found
