"""The normalisers' kernels, on tensors.

Each class has ``normalize``, from cells to descriptors (N, rows, cols, channels); ``vjp``, from the gradient of these
to that of the cells; and ``jvp``, from tangents of the cells (N, rows, cols, bins) to those of the descriptors.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from .block_norms import Blocks, block_norm_kernel, block_norm_vjp_kernel, block_numbers_kernel
from .four_blocks import (
    FourBlocks,
    corners_kernel,
    corners_vjp_kernel,
    four_block_norm_kernel,
    four_block_norm_vjp_kernel,
)
from .launch import EXACT, Cells, on
from .norms import cell_norm_kernel, global_norm_kernel, sums_kernel
from .parameters import power_of_two
from .window_norms import products_kernel, window_factors_kernel, window_norm_kernel

_NUMBERS = 512  # of a tile, or what is nearest: four a thread
_PARTS = 1024  # of an image whose sums are added by one program, at most
_STEP = 4096  # numbers of a part, at least


class NormalizerKernels(ABC):
    """The interface."""

    @abstractmethod
    def _apply(self, cells: Cells, tangents: Tensor | None) -> Tensor:
        """Descriptors, or their tangents."""

    def normalize(self, cells: Cells) -> Tensor:
        """Descriptors (N, rows, cols, channels)."""
        return self._apply(cells, None)

    @abstractmethod
    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        """Gradients (N, rows, cols, bins) of the cells."""

    def jvp(self, cells: Cells, tangents: Tensor) -> Tensor:
        """Tangents of the descriptors."""
        return self._apply(cells, tangents)


def _tile(numbers: int) -> tuple[int, int]:
    """Rows of a tile of so many numbers a row, and these as a power of two."""
    wide = power_of_two(numbers)
    return max(_NUMBERS // wide, 1), wide


def _run(kernel: Any, count: int, tile: int, device: torch.device, *arguments: Any, **constants: Any) -> None:
    """For so many cells, blocks or corners, ``tile`` a program."""
    if count:
        with on(device):
            kernel[(-(-count // tile),)](*arguments, TILE=tile, **constants, **EXACT)


def _new(cells: Cells, *shape: int) -> Tensor:
    return torch.empty(len(cells.values), *shape, dtype=cells.values.dtype, device=cells.values.device)


class GlobalKernels(NormalizerKernels):
    """Eq. 7, with sums over an image in float64."""

    def __init__(self, epsilon: float, robust: bool) -> None:
        self.epsilon, self.robust = epsilon, robust

    def _apply(self, cells: Cells, other: Tensor | None) -> Tensor:
        out = _new(cells, *cells.shape)
        numbers = cells.numbers
        share = -(-max(numbers, 1) // (_STEP * _PARTS)) * _STEP
        parts = -(-numbers // share)
        sums = torch.empty(len(out), parts, 2, dtype=torch.float64, device=out.device)
        if not len(out):
            return out
        x, flags, stride = cells.values, cells.flags, cells.values.stride(0)
        y, other_stride = (x, stride) if other is None else (other, numbers)  # ⟨x, x⟩ twice if there is no other
        with on(out.device):
            grid = (len(out) * parts,)
            sums_kernel[grid](x, y, sums, numbers, share, parts, stride, other_stride, TILE=_NUMBERS, **EXACT)
            global_norm_kernel[grid](
                x,
                y,
                sums,
                flags,
                out,
                numbers,
                share,
                parts,
                stride,
                flags.stride(0),
                EPSILON=self.epsilon,
                ROBUST=self.robust,
                DERIVATIVE=other is not None,
                TILE=_NUMBERS,
                PARTS=power_of_two(parts),
                **EXACT,
            )
        return out

    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        return self._apply(cells, grad_output)  # the Jacobian is symmetric


class CellKernels(NormalizerKernels):
    """Each cell for itself."""

    def __init__(self, epsilon: float) -> None:
        self.epsilon = epsilon

    def _apply(self, cells: Cells, other: Tensor | None) -> Tensor:
        out, (rows, cols, bins) = _new(cells, *cells.shape), cells.shape
        tile, wide = _tile(bins)
        _run(
            cell_norm_kernel,
            len(out) * rows * cols,
            tile,
            out.device,
            cells.values,
            out if other is None else other,
            cells.flags,
            out,
            len(out) * rows * cols,
            rows * cols,
            cells.values.stride(0),
            cells.flags.stride(0),
            COUNT=bins,
            EPSILON=self.epsilon,
            DERIVATIVE=other is not None,
            BINS=wide,
        )
        return out

    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        return self._apply(cells, grad_output)  # the Jacobian is symmetric


class BlockKernels(NormalizerKernels):
    """Rectangular blocks of cells."""

    def __init__(self, scheme: Blocks) -> None:
        self.scheme = scheme

    def _grid(self, cells: Cells) -> tuple[int, int]:
        s, (rows, cols, _) = self.scheme, cells.shape
        return (rows - s.high) // s.down + 1, (cols - s.wide) // s.across + 1

    def _apply(self, cells: Cells, tangents: Tensor | None) -> Tensor:
        grid, s = self._grid(cells), self.scheme
        out = _new(cells, *grid, s.size)
        tile, wide = _tile(s.size)
        changes = cells.values if tangents is None else tangents
        _run(
            block_norm_kernel,
            len(out) * grid[0] * grid[1],
            tile,
            out.device,
            cells.values,
            changes,
            cells.flags,
            out,
            len(out) * grid[0] * grid[1],
            grid[0] * grid[1],
            grid[1],
            cells.shape[1],
            cells.values.stride(0),
            changes.stride(0),
            cells.flags.stride(0),
            SCHEME=s,
            TANGENTS=tangents is not None,
            SIZE=wide,
        )
        return out

    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        grid, s, (rows, cols, bins) = self._grid(cells), self.scheme, cells.shape
        numbers, out = _new(cells, *grid, 4), _new(cells, *cells.shape)
        tile, wide = _tile(s.size)
        stride = cells.values.stride(0)
        blocks = len(out) * grid[0] * grid[1]
        sizes = blocks, grid[0] * grid[1], grid[1], cols, stride
        _run(
            block_numbers_kernel,
            blocks,
            tile,
            out.device,
            cells.values,
            grad_output,
            numbers,
            *sizes,
            SCHEME=s,
            SIZE=wide,
        )
        tile, wide = _tile(bins)
        count = len(out) * rows * cols
        _run(
            block_norm_vjp_kernel,
            count,
            tile,
            out.device,
            cells.values,
            grad_output,
            numbers,
            out,
            count,
            rows * cols,
            rows,
            cols,
            *grid,
            stride,
            SCHEME=s,
            BINS=wide,
        )
        return out


class FourBlockKernels(NormalizerKernels):
    """The four blocks of a cell."""

    def __init__(self, scheme: FourBlocks) -> None:
        self.scheme = scheme

    def _corners(self, cells: Cells, tangents: Tensor | None) -> tuple[Tensor, Tensor]:
        rows, cols, _ = cells.shape
        factors = _new(cells, rows + 1, cols + 1)
        changes = torch.empty_like(factors) if tangents is not None else factors
        other = cells.values if tangents is None else tangents
        tile, wide = _tile(self.scheme.undirected)
        _run(
            corners_kernel,
            factors.numel(),
            tile,
            factors.device,
            cells.values,
            other,
            factors,
            changes,
            factors.numel(),
            rows,
            cols,
            cells.values.stride(0),
            other.stride(0),
            SCHEME=self.scheme,
            TANGENTS=tangents is not None,
            BINS=wide,
        )
        return factors, changes

    def _apply(self, cells: Cells, tangents: Tensor | None) -> Tensor:
        factors, changes = self._corners(cells, tangents)
        (rows, cols, _), margin = cells.shape, 2 * self.scheme.dropped
        out = _new(cells, rows - margin, cols - margin, self.scheme.channels)
        other = cells.values if tangents is None else tangents
        tile, wide = _tile(self.scheme.undirected)
        count = len(out) * (rows - margin) * (cols - margin)
        _run(
            four_block_norm_kernel,
            count,
            tile,
            out.device,
            cells.values,
            other,
            factors,
            changes,
            cells.flags,
            out,
            count,
            rows,
            cols,
            cells.values.stride(0),
            other.stride(0),
            cells.flags.stride(0),
            SCHEME=self.scheme,
            TANGENTS=tangents is not None,
            BINS=wide,
        )
        return out

    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        factors, _ = self._corners(cells, None)
        slopes, out = torch.empty_like(factors), _new(cells, *cells.shape)
        rows, cols, _ = cells.shape
        tile, wide = _tile(self.scheme.undirected)
        for kernel, to, more, count in (
            (corners_vjp_kernel, slopes, (), factors.numel()),
            (four_block_norm_vjp_kernel, out, (slopes,), len(out) * rows * cols),
        ):
            _run(
                kernel,
                count,
                tile,
                out.device,
                cells.values,
                grad_output,
                factors,
                *more,
                to,
                count,
                rows,
                cols,
                cells.values.stride(0),
                SCHEME=self.scheme,
                BINS=wide,
            )
        return out


@lru_cache(maxsize=16)
def _weights(sigma: float, reach: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    return torch.tensor([math.exp(-(d**2) / (2 * sigma**2)) for d in range(reach + 1)], dtype=dtype).to(device)


class WindowKernels(NormalizerKernels):
    """The energy around each cell."""

    def __init__(self, sigma: float, epsilon: float) -> None:
        self.sigma, self.epsilon, self.reach = sigma, epsilon, math.floor(3 * sigma)

    def _apply(self, cells: Cells, other: Tensor | None, transposed: bool = False) -> Tensor:
        (rows, cols, bins), out = cells.shape, _new(cells, *cells.shape)
        y = cells.values if other is None else other
        weights = _weights(self.sigma, self.reach, out.dtype, out.device)
        products, factors = _new(cells, rows, cols, 2), _new(cells, rows, cols, 2)
        count, stride = len(out) * rows * cols, cells.values.stride(0)
        tile, wide = _tile(bins)
        of_cells: dict[str, Any] = {"COUNT": bins, "BINS": wide}
        sizes = count, rows * cols, stride, y.stride(0)
        _run(products_kernel, count, tile, out.device, cells.values, y, products, *sizes, **of_cells)
        _run(
            window_factors_kernel,
            count,
            tile,
            out.device,
            products,
            factors,
            weights,
            count,
            rows,
            cols,
            EPSILON=self.epsilon,
            REACH=self.reach,
        )
        _run(
            window_norm_kernel,
            count,
            tile,
            out.device,
            cells.values,
            y,
            products,
            factors,
            cells.flags,
            out,
            weights,
            count,
            rows,
            cols,
            stride,
            cells.flags.stride(0),
            DERIVATIVE=other is not None,
            TRANSPOSED=transposed,
            REACH=self.reach,
            **of_cells,
        )
        return out

    def vjp(self, cells: Cells, grad_output: Tensor) -> Tensor:
        return self._apply(cells, grad_output, transposed=True)
