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

from ..engine import Cells, Describe, Engine, OutputAndSaved, jvp_by_vjp, real_dtype
from ..spec import HOGSpec
from ..steps import normalize_reference, spread_nan
from . import votes
from .cells import LANES, cells_kernel
from .cells_vjp import cells_vjp_kernel
from .parameters import KernelTables, Reading, columns_at_once, make_tables

RULES = {name: getattr(votes, f"{name}_votes") for name in ("linear", "opencv", "vlfeat", "nearest", "begun")}
"""Vote rules by their names: those of :class:`..orientation.VoteRule`."""

EXACT_PRODUCTS: dict[str, Any] = {"enable_fp_fusion": False}
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


@lru_cache
def schedulers(device: torch.device) -> int:
    """The number of warp schedulers of a GPU, each one instruction per cycle; 1 for a CPU."""
    if device.type != "cuda":
        return 1
    return _SCHEDULERS * torch.cuda.get_device_properties(device).multi_processor_count


def _reading(tables: KernelTables, *images: Tensor) -> Reading:
    """The reading with the strides of these images."""
    span = max(
        sum((n - 1) * abs(stride) for n, stride in zip(x.shape[1:], x.stride()[1:], strict=True)) for x in images
    )
    return tables.reading._replace(wide=True) if span >= 2**31 else tables.reading


def _image_tables(images: Tensor, spec: HOGSpec) -> KernelTables:
    return make_tables(spec, images.shape, images.dtype, real_dtype(images.dtype), images.device)


class Work(NamedTuple):
    """How cells are divided among programs: some strips each, and the rows and columns of cells in a strip."""

    chunks: int  # of columns of cells
    chunk_cols: int  # columns of cells
    strips: tuple[int, int]  # of an image; of a program
    strip_rows: int  # rows of cells

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
        chunk_cols = -(-cols // chunks)
        return cols * (LANES // (chunk_cols + wide - 1)) / (chunks * LANES)

    chunks = max(range(narrow, min(cols, narrow + LANES) + 1), key=used)
    chunk_cols = -(-cols // chunks)
    side_by_side = LANES // (chunk_cols + wide - 1)

    def time(strip_rows: int) -> float:  # of the scheduler with the most programs, in bands of rows
        programs = images * chunks * -(-rows // (strip_rows * side_by_side))
        return max(-(-programs // schedulers), _ALONE) * (strip_rows + high - 1 + _START)

    strip_rows = min(range(1, min(-(-rows // side_by_side), _MOST_ROWS) + 1), key=time)
    return Work(chunks, chunk_cols, (-(-rows // strip_rows), side_by_side), strip_rows)


def flagged_cells(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Eq. 1-6: of images (B, C, H, W), as stored, any strides.

    Returns:
        Histograms (B, rows, cols, bins), and (B,) not 0 where they are arbitrary: a pixel is not finite.
    """
    tables = _image_tables(images, spec)
    rows, cols = tables.rows, tables.cols
    shape, count = (rows.cells, cols.cells, spec.bins), len(images)
    if math.prod(shape) >= 2**31:
        raise ValueError(
            f"the backend 'triton' takes fewer than 2³¹ cells · bins an image, got {shape[0]}x{shape[1]} · {shape[2]}"
        )
    out = torch.empty(count, *shape, dtype=real_dtype(images.dtype), device=images.device)
    flags = out.new_zeros(count)
    if not count:
        return out, flags
    stride, *strides = images.stride()
    reach = rows.bands.reach, cols.bands.reach
    share = work(count, (rows.cells, cols.cells), reach, schedulers(images.device))
    registers = tables.reading.channels * (out.itemsize // 4)
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
            tuple(strides),
            (rows.cells, cols.cells),
            (rows.bands.longest, cols.bands.longest),
            share.chunks,
            share.chunk_cols,
            share.strips,
            share.strip_rows,
            (*rows.voting, *cols.voting),
            tables.last_wins,
            images.shape[1],
            VOTES=RULES[tables.rule],
            READING=_reading(tables, images),
            VOTING=tables.voting,
            HIGH=rows.bands.reach,
            WIDE=cols.bands.reach,
            AT_ONCE=columns_at_once(cols.bands, registers),
            CLAMPED=cols.bands.longest > images.shape[3],
            CHECKED=images.is_floating_point(),
            num_warps=1,
            **EXACT_PRODUCTS,
        )
    return out, flags


def flagged_cells_vjp(images: Tensor, flags: Tensor, grad_cells: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients (B, C, H, W) of the images from those of their cells (B, rows, cols, bins), both without gaps."""
    tables = _image_tables(images, spec)
    height, width = images.shape[2:]
    stride, *strides = images.stride()
    out = torch.empty_like(images, memory_format=torch.contiguous_format)
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
                tables.rows.gather.first,
                tables.rows.gather.weights,
                tables.cols.gather.first,
                tables.cols.gather.weights,
                (height, width),
                stride,
                tuple(strides),
                (tables.rows.cells, tables.cols.cells),
                chunks,
                tables.last_wins,
                VOTES=RULES[tables.rule],
                READING=_reading(tables, images, out),
                VOTING=tables.voting,
                HIGH=tables.rows.gather.reach,
                WIDE=tables.cols.gather.reach,
                TILE_Y=tile_y,
                TILE_X=tile_x,
                num_warps=_VJP_WARPS,
                **EXACT_PRODUCTS,
            )
    return out


class TritonCells(Cells):
    """Eq. 1-6, of float16 and bfloat16 images, too."""

    def run(self, x: Tensor, saves: bool = True) -> OutputAndSaved:
        """Cells, and (B, 1), not 0 where an image has a pixel that is not finite."""
        cells, flags = flagged_cells(x, self.spec)
        return torch.where(flags.reshape(-1, 1, 1, 1) != 0, torch.nan, cells), flags.unsqueeze(1)

    def vjp(self, x: Tensor, saved: Tensor, grad_output: Tensor) -> Tensor:
        return flagged_cells_vjp(x, saved.flatten(), grad_output.contiguous(), self.derivative_spec)

    def jvp(self, x: Tensor, saved: Tensor, tangent: Tensor) -> Tensor:
        return jvp_by_vjp(self.reference, (x,), (tangent,))


class TritonDescribe(Describe):
    """Eq. 1-7, for graphs that were exported on a CPU: cells, and the reference's normaliser."""

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype) -> None:
        super().__init__(spec, shape, stored, real)
        self._cells = TritonCells(spec, shape, stored, real)

    def _normalize(self, cells: Tensor) -> Tensor:
        return normalize_reference(cells.permute(0, 3, 1, 2), self.spec).permute(0, 2, 3, 1)

    def run(self, x: Tensor, saves: bool = True) -> OutputAndSaved:
        cells, flags = self._cells.run(x)
        return spread_nan(self._normalize(cells), x).contiguous(), flags

    def vjp(self, x: Tensor, saved: Tensor, grad_output: Tensor) -> Tensor:
        cells, flags = self._cells.run(x)
        return self._cells.vjp(x, flags, torch.func.vjp(self._normalize, cells)[1](grad_output)[0])

    def jvp(self, x: Tensor, saved: Tensor, tangent: Tensor) -> Tensor:
        return jvp_by_vjp(self.reference, (x,), (tangent,))


TRITON_ENGINE = Engine(TritonCells)
EXPORTED_ENGINE = Engine(TritonCells, describe=TritonDescribe)
