"""The two passes over pixels in Triton, as functions of PyTorch; cells are normalised by the reference.

Nothing here waits for the device, or asks it for a number: all of it can be captured in a CUDA graph, once the tables
of a dialect and an image size are on the device, that is after a first call.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..autograd import Step, apply, cells_reference, jvp_by_vjp
from ..spec import HOGSpec
from ..steps import merge_colours, normalize_reference, split_colours, spread_nan
from . import votes
from .cells import LANES, cells_kernel
from .cells_vjp import cells_vjp_kernel
from .parameters import Plan, Reading, columns_at_once, plan

RULES = {name: getattr(votes, f"{name}_votes") for name in ("linear", "opencv", "vlfeat", "nearest", "begun")}
"""Vote rules by their names: those of :class:`..orientation.VoteRule`."""

EXACT: dict[str, Any] = {"enable_fp_fusion": False}
"""a · b + c is rounded twice, as in PyTorch: which of two equal channels or bins counts must not depend on it."""
VJP_ROWS, VJP_COLUMNS = 16, 32
"""Pixels of a tile of the vjp, with its rim."""
_VJP_WARPS = 4  # four pixels a thread
_MOST_ROWS = 16  # of cells in a strip
_SCHEDULERS = 4  # of a multiprocessor
_ALONE = 1.5  # a guess: how much longer a warp takes that waits for memory with no other warp beside it
_START = 0.1  # of a program, in bands of rows of a strip


def on(device: torch.device) -> AbstractContextManager[Any]:
    """Launches go to this device."""
    return torch.cuda.device(device) if device.type == "cuda" else nullcontext()


def real_dtype(images: Tensor) -> torch.dtype:
    """The dtype that images are computed in."""
    stored = torch.get_default_dtype() if images.dtype == torch.uint8 else images.dtype
    return torch.float64 if stored == torch.float64 else torch.float32


@lru_cache
def schedulers(device: torch.device) -> int:
    """The number of warp schedulers of a GPU, each one instruction per cycle; 1 for a CPU."""
    if device.type != "cuda":
        return 1
    return _SCHEDULERS * torch.cuda.get_device_properties(device).multi_processor_count


def _strides(images: Tensor, spec: HOGSpec) -> tuple[int, tuple[int, int, int]]:
    """From image to image, and of channel, row, column; a gray image has the same colour three times."""
    batch, channel, row, col = images.stride()
    return batch, (0 if spec.colours > images.shape[1] else channel, row, col)


def _reading(known: Plan, *images: Tensor) -> Reading:
    """The plan's reading with the strides of these images."""
    span = max(
        sum((n - 1) * abs(step) for n, step in zip(each.shape[1:], each.stride()[1:], strict=True)) for each in images
    )
    return known.reading._replace(wide=True) if span >= 2**31 else known.reading


def _plan(images: Tensor, spec: HOGSpec) -> Plan:
    return plan(spec, images.shape, images.dtype, real_dtype(images), images.device)


class Work(NamedTuple):
    """How cells are divided among programs: some strips each, and the rows and columns of cells in a strip."""

    chunks: int  # of columns of cells
    of_chunk: int  # columns of cells
    strips: tuple[int, int]  # of an image; of a program
    of_strip: int  # rows of cells

    @property
    def groups(self) -> int:
        """Groups of strips, one program each."""
        return -(-self.strips[0] // self.strips[1])


@lru_cache(maxsize=256)
def work(images: int, cells: tuple[int, int], reach: tuple[int, int], schedulers: int) -> Work:
    """How to divide images with these rows and columns of cells; a band votes into ``reach`` of either."""
    (rows, cols), (high, wide) = cells, reach
    narrow = -(-cols // (LANES - wide + 1))

    def used(chunks: int) -> float:  # share of the lanes that own cells
        of_chunk = -(-cols // chunks)
        return cols * (LANES // (of_chunk + wide - 1)) / (chunks * LANES)

    chunks = max(range(narrow, min(cols, narrow + LANES) + 1), key=used)
    of_chunk = -(-cols // chunks)
    side_by_side = LANES // (of_chunk + wide - 1)

    def time(of_strip: int) -> float:  # of the scheduler with the most programs, in bands of rows
        programs = images * chunks * -(-rows // (of_strip * side_by_side))
        return max(-(-programs // schedulers), _ALONE) * (of_strip + high - 1 + _START)

    of_strip = min(range(1, min(-(-rows // side_by_side), _MOST_ROWS) + 1), key=time)
    return Work(chunks, of_chunk, (-(-rows // of_strip), side_by_side), of_strip)


def flagged_cells(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Eq. 1-6: of images (B, C, H, W), as stored, any strides, with N = B · colours.

    Returns:
        Histograms (N, rows, cols, bins), and (N,) not 0 where they are arbitrary: a pixel is not finite.
    """
    known = _plan(images, spec)
    rows, cols = known.rows, known.cols
    shape, count = (rows.cells, cols.cells, spec.bins), len(images) * spec.colours
    if math.prod(shape) >= 2**31:
        raise ValueError(
            f"the backend 'triton' takes fewer than 2³¹ cells · bins an image, got {shape[0]}x{shape[1]} · {shape[2]}"
        )
    out = torch.empty(count, *shape, dtype=real_dtype(images), device=images.device)
    flags = out.new_zeros(count)
    if not count:
        return out, flags
    stride, strides = _strides(images, spec)
    reach = rows.bands.reach, cols.bands.reach
    share = work(count, (rows.cells, cols.cells), reach, schedulers(images.device))
    registers = known.reading.channels * (out.itemsize // 4)
    with on(images.device):
        cells_kernel[(count * share.groups * share.chunks,)](
            images,
            out,
            flags,
            rows.bands.first,
            rows.bands.weights,
            cols.bands.first,
            cols.bands.weights,
            tuple(images.shape[2:]),
            stride,
            strides,
            (rows.cells, cols.cells),
            (rows.bands.longest, cols.bands.longest),
            share.chunks,
            share.of_chunk,
            share.strips,
            share.of_strip,
            (*rows.voting, *cols.voting),
            known.last_wins,
            images.shape[1],
            VOTES=RULES[known.rule],
            READING=_reading(known, images),
            VOTING=known.voting,
            COLOURS=spec.colours,
            HIGH=rows.bands.reach,
            WIDE=cols.bands.reach,
            AT_ONCE=columns_at_once(cols.bands, registers),
            CLAMPED=cols.bands.longest > images.shape[3],
            CHECKED=images.is_floating_point(),
            num_warps=1,
            **EXACT,
        )
    return out, flags


def _with_derivative(spec: HOGSpec) -> HOGSpec:
    """The dialect whose derivative is meant."""
    return spec.with_linear_votes() if spec.vote == "hard" and spec.derivative == "linear" else spec


def flagged_cells_vjp(images: Tensor, flags: Tensor, grad_cells: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients (B, C, H, W) of the images from those of their cells (N, rows, cols, bins), both without gaps."""
    spec = _with_derivative(spec)
    known = _plan(images, spec)
    batch, channels, height, width = images.shape
    stride, strides = _strides(images, spec)
    described = 1 if spec.colours > 1 else channels
    dtype = images.dtype if images.is_floating_point() else real_dtype(images)
    out = torch.empty(batch * spec.colours, described, height, width, dtype=dtype, device=images.device)
    tile_y, tile_x = VJP_ROWS, VJP_COLUMNS
    chunks = -(-height // (tile_y - 2)), -(-width // (tile_x - 2))
    programs = len(out) * chunks[0] * chunks[1]
    if programs:
        with on(images.device):
            cells_vjp_kernel[(programs,)](
                images,
                grad_cells,
                flags,
                out,
                known.rows.gather.first,
                known.rows.gather.weights,
                known.cols.gather.first,
                known.cols.gather.weights,
                (height, width),
                stride,
                strides,
                (known.rows.cells, known.cols.cells),
                chunks,
                known.last_wins,
                VOTES=RULES[known.rule],
                READING=_reading(known, images, out),
                VOTING=known.voting,
                COLOURS=spec.colours,
                HIGH=known.rows.gather.reach,
                WIDE=known.cols.gather.reach,
                TILE_Y=tile_y,
                TILE_X=tile_x,
                num_warps=_VJP_WARPS,
                **EXACT,
            )
    if spec.colours == 1:
        return out
    each = out.reshape(batch, spec.colours, height, width)
    return each if channels > 1 else each.sum(1, keepdim=True)


def _cells(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Cells (B, rows, cols, colours · bins), and which of the images (B, colours) are not finite."""
    cells, flags = flagged_cells(images, spec)
    finite = torch.where(flags.reshape(-1, 1, 1, 1) != 0, torch.nan, cells)
    return merge_colours(finite, spec), flags.reshape(-1, spec.colours)


def _cells_vjp(images: Tensor, flags: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    return flagged_cells_vjp(images, flags.flatten(), split_colours(grad_output, spec).contiguous(), spec)


def _cells_jvp(images: Tensor, _: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    return jvp_by_vjp(lambda of: cells_reference(of, spec), (images,), (tangents,))


CELLS = Step(_cells, _cells_vjp, _cells_jvp, cells_reference)


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images (B, C, H, W), float16 and bfloat16 included."""
    spec.grid(*images.shape[2:])
    return apply(CELLS, images, spec).permute(0, 3, 1, 2)


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels)."""
    descriptor = spread_nan(normalize_reference(histograms(images, spec), spec), images)
    return descriptor.permute(0, 2, 3, 1).contiguous()


@torch.no_grad()
def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6 without a graph: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    return _cells(images, spec)[0].contiguous()


@torch.no_grad()
def cells_vjp(images: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients with respect to the images from those with respect to the cells."""
    return _cells_vjp(images, _cells(images, spec)[1], grad_output, spec).contiguous()


def describe_vjp(images: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients with respect to the images from those with respect to the descriptors."""
    with torch.enable_grad():
        x = images.requires_grad_()
        return torch.autograd.grad(describe(x, spec), x, grad_output)[0]
