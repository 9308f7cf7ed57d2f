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


class _Loops:
    """What the loops need to know of images of a size, and the loops for them, found once."""

    def __init__(self, *plan: Any) -> None:
        self.plan = plan
        self._found: dict[Any, Callable[..., None]] = {}

    def run(self, loop: Any, *arguments: Any) -> None:
        """Calls a loop; of one plan, its arguments are always of the same types."""
        found = self._found.get(loop)
        if found is None:
            found = self._found[loop] = loop.for_types_of(*arguments)
        found(*arguments)


def _stored(images: Tensor) -> tuple[Any, int, tuple[int, int], tuple[int, ...]]:
    """The values in memory, wherever each lies: of any strides without a copy."""
    _, _, height, width = images.shape
    if images.is_contiguous():
        plane = height * width
        return images.numpy().reshape(-1), 0, (height, width), (images.shape[1] * plane, plane, width, 1)
    strides = images.stride()
    span = 1 + sum((n - 1) * step for n, step in zip(images.shape, strides, strict=True))
    return images.as_strided((span,), (1,)).numpy(), 0, (height, width), strides


@lru_cache(maxsize=64)
def _loops(spec: HOGSpec, shape: torch.Size, stored: torch.dtype) -> _Loops:
    dtype = torch.float64 if stored == torch.float64 else torch.float32
    real = np.float64 if dtype == torch.float64 else np.float32
    return _Loops(
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
    if count == 0:
        return
    if count == 1 or torch.get_num_threads() == 1:
        work(0, count)
        return
    parts = _parts(count)
    in_threads(lambda k: work(*parts[k]), len(parts))


def _in_bands(images: Tensor) -> bool:
    """Whether threads share out parts of an image, not whole ones."""
    return len(images) == 1 and images.shape[2] * images.shape[3] >= _LARGE and torch.get_num_threads() > 1


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W), C = 1 if colours are separate, to cells (B, rows, cols, bins)."""
    loops = _loops(spec, images.shape[1:], images.dtype)
    plan, pooling = (*_stored(images), *loops.plan), loops.plan[-1]
    dtype = torch.float64 if images.dtype == torch.float64 else torch.float32
    found = torch.empty((images.shape[0], pooling.rows, pooling.cols, pooling.bins), dtype=dtype)
    array = found.numpy()
    if _in_bands(images):
        of_bands = np.empty((len(pooling.bands), (pooling.cols + pooling.wide) * pooling.of_cell), array.dtype)
        _share_out(lambda start, stop: loops.run(cells_of_bands, *plan, start, stop, of_bands), len(of_bands))
        loops.run(add_bands, of_bands, pooling, array[0])
    else:
        _share_out(lambda start, stop: loops.run(cells_of_images, *plan, start, stop, array), len(array))
    return found


def cells_back(images: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """The adjoint: what reaches the images from ``given`` (B, rows, cols, bins), of the cells."""
    loops = _loops(_followed(spec), images.shape[1:], images.dtype)
    plan, reached = (*_stored(images), *loops.plan), given.contiguous().numpy()
    found = torch.empty(images.shape, dtype=given.dtype)
    array = found.numpy()
    if _in_bands(images):
        one, of_one = array[0], reached[0]
        _share_out(lambda start, stop: loops.run(cells_adjoint, *plan, of_one, start, stop, one), images.shape[2])
    else:
        _share_out(lambda start, stop: loops.run(adjoints_of_images, *plan, reached, start, stop, array), len(array))
    return found


def cells_forward(images: Tensor, changes: Tensor, spec: HOGSpec) -> Tensor:
    """How cells (B, rows, cols, bins) change with ``changes`` of the images."""
    stored = _stored(images)
    loops = _loops(_followed(spec), images.shape[1:], images.dtype)
    reading, voting, pooling = loops.plan
    beyond = reading._replace(beyond=reading.beyond * 0)
    found = torch.empty((images.shape[0], pooling.rows, pooling.cols, pooling.bins), dtype=changes.dtype)
    array, moved = found.numpy(), changes.contiguous().numpy()

    def work(start: int, stop: int) -> None:
        plan = *stored, moved, reading, beyond, voting, pooling
        loops.run(tangents_of_images, *plan, start, stop, array)

    _share_out(work, len(array))
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
    _share_out(lambda start, stop: loop(array, scheme, start, stop, to), len(array))
    return found


def norm_back(histograms: Tensor, given: Tensor, spec: HOGSpec) -> Tensor:
    """Its adjoint: what reaches the histograms from ``given`` (B, rows, cols, channels), of the descriptors."""
    array, reached = histograms.contiguous().numpy(), given.contiguous().numpy()
    _, loop, scheme = _norm(spec, array.itemsize == 4)
    found = torch.empty(array.shape, dtype=histograms.dtype)
    to = found.numpy()
    _share_out(lambda start, stop: loop(array, scheme, reached, start, stop, to), len(array))
    return found
