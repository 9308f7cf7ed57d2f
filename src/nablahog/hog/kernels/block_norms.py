"""The normaliser of rectangular blocks of cells, compiled, with its vjp.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels); a loop goes over images ``start``
to ``stop`` of them, and gathers each block in one vector.

Numba vectorises these loops well enough: vector instructions gained 1.10 (`opencv`) to 1.14 (`skimage`) in a call of
`hog`, and 1.02 (`opencv`) in its vjp (AMD EPYC, AVX2, float32, one image of 256 x 256), and were removed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Real
from ...runtime.compile import compiled, inlined
from ..normalizers import BlockNorm
from .norms import copy, dot

_L1, _L1_SQRT, _L2, _L2_HYS = range(4)


class Blocks(NamedTuple):
    """What the loops know of a :class:`.normalizers.BlockNorm`."""

    high: int  # cells
    wide: int
    down: int  # cells from block to block
    across: int
    form: int
    epsilon: Real
    epsilon_again: Real
    epsilon_outside_root: bool
    clip: Real


def rectangles(scheme: BlockNorm, real: type[Real]) -> Blocks:
    """In float32 or float64, ``real``."""
    form = {"L1": _L1, "L1-sqrt": _L1_SQRT, "L2": _L2, "L2-Hys": _L2_HYS}[scheme.form]
    epsilons = real(scheme.epsilon), real(scheme.epsilon_again)
    return Blocks(*scheme.block, *scheme.step, form, *epsilons, scheme.epsilon_outside_root, real(scheme.clip))


@inlined
def _sums_of_cells(histograms: Floats, bins: int, squares: bool, out: Floats) -> None:
    """For each cell, the sum of its bins, or of their squares."""
    for cell in range(out.size):
        at = cell * bins
        if squares:
            out[cell] = dot(histograms, at, histograms, at, bins)
        else:
            total = histograms[at]
            for k in range(1, bins):
                total += histograms[at + k]
            out[cell] = total


@inlined
def _sum_of_block(of_cells: Floats, row: int, col: int, cols: int, scheme: Blocks) -> Real:
    """The sum over the cells of the block that begins at a cell."""
    total: Real = of_cells[0] - of_cells[0]
    for y in range(row, row + scheme.high):
        for x in range(col, col + scheme.wide):
            total += of_cells[y * cols + x]
    return total


@inlined
def _factor(energy: Real, epsilon: Real, epsilon_outside_root: bool) -> Real:
    """The factor f of L2: ŷ = f · x."""
    one = epsilon / epsilon
    length = math.sqrt(energy) + epsilon if epsilon_outside_root else math.sqrt(energy + epsilon * epsilon)
    factor: Real = one / length
    return factor


@inlined
def _slope(energy: Real, product: Real, epsilon: Real, epsilon_outside_root: bool) -> Real:
    """The coefficient s of L2's vjp, x̄ = f · ȳ - s · x, with ``product`` = ⟨x, ȳ⟩."""
    factor: Real = _factor(energy, epsilon, epsilon_outside_root)
    if not epsilon_outside_root:
        cubed: Real = factor * factor * factor * product
        return cubed
    slope: Real = factor * factor * product / math.sqrt(energy) if energy > 0 else energy
    return slope


class _Block(NamedTuple):
    """Workspace: vectors of a block, its cells' bins by rows of cells."""

    x: Floats  # histograms
    unit: Floats  # normalised, before and after the clip
    grad: Floats  # gradients with respect to the first normalisation


@inlined
def _new_block(size: int, dtype: DType) -> _Block:
    return _Block(np.empty(size, dtype), np.empty(size, dtype), np.empty(size, dtype))


@inlined
def _gather(histograms: Floats, begin: int, row_size: int, count: int, high: int, x: Floats) -> None:
    """Copies ``high`` rows of cells of a block, ``count`` numbers each, ``row_size`` apart."""
    for row in range(high):
        copy(histograms, begin + row * row_size, count, x, row * count)


@inlined
def _clipped(x: Floats, factor: Real, clip: Real, out: Floats) -> None:
    """min(factor · x, clip)."""
    for k in range(out.size):
        value = x[k] * factor
        out[k] = clip if value > clip else value


@inlined
def _normalize_block(block: _Block, total: Real, scheme: Blocks, out: Floats, to: int) -> None:
    """From ``block.x``, whose sum or sum of squares is ``total``."""
    x, size, place = block.x, block.x.size, np.uintp(to)
    if scheme.form == _L2_HYS:
        factor = _factor(total, scheme.epsilon, scheme.epsilon_outside_root)
        _clipped(x, factor, scheme.clip, block.unit)
        energy = dot(block.unit, 0, block.unit, 0, size)
        factor = _factor(energy, scheme.epsilon_again, scheme.epsilon_outside_root)
        x = block.unit
    elif scheme.form == _L2:
        factor = _factor(total, scheme.epsilon, scheme.epsilon_outside_root)
    else:
        factor = scheme.epsilon / scheme.epsilon / (total + scheme.epsilon)
    if scheme.form == _L1_SQRT:
        for k in range(size):
            out[place + np.uintp(k)] = math.sqrt(x[k] * factor)
    else:
        for k in range(size):
            out[place + np.uintp(k)] = x[k] * factor


@compiled
def block_norm(images: Floats, scheme: Blocks, start: int, stop: int, out: Floats) -> None:
    """Histograms to blocks: see :meth:`nablahog.hog.BlockNorm.normalize`."""
    _, rows, cols, size = out.shape
    bins, row_size, count = images.shape[3], images.shape[2] * images.shape[3], scheme.wide * images.shape[3]
    block, of_cells = _new_block(size, images.dtype), np.empty(images.shape[1] * images.shape[2], images.dtype)
    for image in range(start, stop):
        histograms, of_image, to = images[image].reshape(-1), out[image].reshape(-1), 0
        _sums_of_cells(histograms, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                y, x = row * scheme.down, col * scheme.across
                _gather(histograms, y * row_size + x * bins, row_size, count, scheme.high, block.x)
                _normalize_block(block, _sum_of_block(of_cells, y, x, images.shape[2], scheme), scheme, of_image, to)
                to += size


@inlined
def _clip_vjp(block: _Block, factor: Real, scheme: Blocks, grad: Floats, begin: int) -> None:
    """L2-Hys: from gradients of the result to those of the first normalisation, ``block.grad``.

    At the clip itself the mean of both sides passes.
    """
    x, unit, out, clip, size = block.x, block.unit, block.grad, scheme.clip, block.x.size
    half, zero = x.dtype.type(0.5), x.dtype.type(0)
    _clipped(x, factor, clip, unit)
    energy, product = dot(unit, 0, unit, 0, size), dot(unit, 0, grad, begin, size)
    again = _factor(energy, scheme.epsilon_again, scheme.epsilon_outside_root)
    slope = _slope(energy, product, scheme.epsilon_again, scheme.epsilon_outside_root)
    for k in range(size):
        through = grad[np.uintp(begin) + np.uintp(k)] * again - unit[k] * slope
        value = x[k] * factor
        through = through * half if value == clip else through
        out[k] = zero if value > clip else through


@inlined
def _sqrt_vjp(block: _Block, factor: Real, grad: Floats, begin: int) -> None:
    """L1-sqrt: from gradients of the roots to those of the first normalisation, ``block.grad``; none of zero."""
    x, out, half, zero = block.x, block.grad, block.x.dtype.type(0.5), block.x.dtype.type(0)
    for k in range(x.size):
        root = math.sqrt(x[k] * factor)
        out[k] = grad[np.uintp(begin) + np.uintp(k)] * half / root if root > zero else zero


@inlined
def _block_vjp(block: _Block, total: Real, scheme: Blocks, grad: Floats, begin: int) -> tuple[Real, Real, Real]:
    """To ``block.grad``, gradients of the first normalisation; its vjp is x̄ = f · ȳ - s · x - t: returns f, s, t."""
    size, zero = block.x.size, total - total
    if scheme.form >= _L2:
        factor = _factor(total, scheme.epsilon, scheme.epsilon_outside_root)
    else:
        factor = scheme.epsilon / scheme.epsilon / (total + scheme.epsilon)
    if scheme.form == _L2_HYS:
        _clip_vjp(block, factor, scheme, grad, begin)
    elif scheme.form == _L1_SQRT:
        _sqrt_vjp(block, factor, grad, begin)
    else:
        copy(grad, begin, size, block.grad, 0)
    product = dot(block.x, 0, block.grad, 0, size)
    if scheme.form >= _L2:
        return factor, _slope(total, product, scheme.epsilon, scheme.epsilon_outside_root), zero
    return factor, zero, factor * factor * product


@compiled
def block_norm_vjp(
    images: Floats, scheme: Blocks, grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """Gradients of blocks to those of histograms."""
    _, rows, cols, size = grad_output.shape
    bins, row_size, count = images.shape[3], images.shape[2] * images.shape[3], scheme.wide * images.shape[3]
    block, of_cells = _new_block(size, images.dtype), np.empty(images.shape[1] * images.shape[2], images.dtype)
    for image in range(start, stop):
        histograms, grad, out = images[image].reshape(-1), grad_output[image].reshape(-1), grad_input[image].reshape(-1)
        out[:] = 0
        begin = 0
        _sums_of_cells(histograms, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                y, x = row * scheme.down, col * scheme.across
                at = y * row_size + x * bins
                _gather(histograms, at, row_size, count, scheme.high, block.x)
                total = _sum_of_block(of_cells, y, x, images.shape[2], scheme)
                factor, slope, less = _block_vjp(block, total, scheme, grad, begin)
                values, grads = block.x, block.grad
                for line in range(scheme.high):
                    first, to = np.uintp(line * count), np.uintp(at + line * row_size)
                    for k in range(count):
                        j = first + np.uintp(k)
                        out[to + np.uintp(k)] += grads[j] * factor - (values[j] * slope + less)
                begin += size
