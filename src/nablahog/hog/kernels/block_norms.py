"""The normaliser of rectangular blocks of cells, compiled, with its vjp.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels); a loop goes over images ``start``
to ``stop`` of them, and gathers each block in lines: see :mod:`.norm_simd`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import Floats, Real
from ...runtime.compile import compiled, inlined
from .norm_simd import add, clipped, clipped_norm_vjp, copy, copy_scaled, dot, norm_vjp, read_line, roots, roots_vjp
from .norms import whole_eights

_L1, _L1_SQRT, _L2, _L2_HYS = range(4)
FORMS = {"L1": _L1, "L1-sqrt": _L1_SQRT, "L2": _L2, "L2-Hys": _L2_HYS}


class Blocks(NamedTuple):
    """What the loops know of a ``BlockNorm``."""

    high: int  # cells
    wide: int
    down: int  # cells from block to block
    across: int
    form: int  # of FORMS
    epsilon: Real
    epsilon_again: Real
    epsilon_outside_root: bool
    clip: Real


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


class _Shape(NamedTuple):
    """Of a block: each of its rows of cells is a line."""

    high: int  # rows
    row: int  # numbers of a row
    line: int
    row_size: int  # from row to row in the histograms of an image


@inlined
def _shape(images: Floats, scheme: Blocks) -> _Shape:
    cols, bins = images.shape[2:]
    count = scheme.wide * bins
    return _Shape(scheme.high, count, whole_eights(count), cols * bins)


@inlined
def _read_rows(source: Floats, begin: int, row_size: int, shape: _Shape, out: Floats) -> None:
    """Copies the rows of a block, ``row_size`` apart, to lines."""
    for row in range(shape.high):
        read_line(source, begin + row * row_size, 0, shape.row, out, row * shape.line)


@inlined
def _first_factor(total: Real, scheme: Blocks) -> Real:
    """The factor of the first normalisation, of a block with a sum, or sum of squares, ``total``."""
    factor: Real = scheme.epsilon / scheme.epsilon / (total + scheme.epsilon)
    return _factor(total, scheme.epsilon, scheme.epsilon_outside_root) if scheme.form >= _L2 else factor


@inlined
def _normalize_block(x: Floats, total: Real, scheme: Blocks, unit: Floats) -> Real:
    """From the lines ``x`` to lines of ``unit``: the result is a factor, which is returned, times these."""
    factor: Real = _first_factor(total, scheme)
    if scheme.form == _L2_HYS:
        clipped(x, factor, scheme.clip, unit, 0)
        energy = dot(unit, 0, unit, 0, unit.size)
        factor = _factor(energy, scheme.epsilon_again, scheme.epsilon_outside_root)
    elif scheme.form == _L1_SQRT:
        roots(x, factor, unit, 0)
        factor = factor / factor
    else:
        copy(x, 0, x.size, unit, 0)
    return factor


@compiled
def block_norm(images: Floats, scheme: Blocks, start: int, stop: int, out: Floats) -> None:
    """Histograms to blocks: see :meth:`nablahog.hog.BlockNorm.normalize`."""
    _, rows, cols, size = out.shape
    bins, dtype, shape = images.shape[3], images.dtype, _shape(images, scheme)
    x, unit = np.zeros(shape.high * shape.line, dtype), np.zeros(shape.high * shape.line, dtype)
    of_cells = np.empty(images.shape[1] * images.shape[2], dtype)
    for image in range(start, stop):
        histograms, of_image, to = images[image].reshape(-1), out[image].reshape(-1), 0
        _sums_of_cells(histograms, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                first, left = row * scheme.down, col * scheme.across
                _read_rows(histograms, first * shape.row_size + left * bins, shape.row_size, shape, x)
                total = _sum_of_block(of_cells, first, left, images.shape[2], scheme)
                factor = _normalize_block(x, total, scheme, unit)
                for k in range(shape.high):
                    copy_scaled(unit, k * shape.line, shape.row, of_image, to + k * shape.row, factor)
                to += size


@inlined
def _clip_vjp(x: Floats, grad: Floats, factor: Real, scheme: Blocks, unit: Floats) -> None:
    """L2-Hys: from gradients of the result to those of the first normalisation, ``grad``; overwrites ``unit``."""
    epsilon, outside, size = scheme.epsilon_again, scheme.epsilon_outside_root, x.size
    clipped(x, factor, scheme.clip, unit, 0)
    energy, product = dot(unit, 0, unit, 0, size), dot(unit, 0, grad, 0, size)
    again, slope = _factor(energy, epsilon, outside), _slope(energy, product, epsilon, outside)
    clipped_norm_vjp(x, grad, factor, scheme.clip, again, slope, grad, 0)


@inlined
def _block_vjp(x: Floats, grad: Floats, total: Real, scheme: Blocks, unit: Floats) -> None:
    """From gradients of the result, ``grad``, to those of the histograms, ``unit``; overwrites ``grad``."""
    factor, zero = _first_factor(total, scheme), total - total
    if scheme.form == _L2_HYS:
        _clip_vjp(x, grad, factor, scheme, unit)
    elif scheme.form == _L1_SQRT:
        roots_vjp(x, grad, factor, grad, 0)
    product = dot(x, 0, grad, 0, x.size)
    if scheme.form >= _L2:
        slope = _slope(total, product, scheme.epsilon, scheme.epsilon_outside_root)
        norm_vjp(x, grad, factor, slope, zero, unit, 0)
    else:
        norm_vjp(x, grad, factor, zero, factor * factor * product, unit, 0)


@compiled
def block_norm_vjp(
    images: Floats, scheme: Blocks, grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """Gradients of blocks to those of histograms."""
    _, rows, cols, size = grad_output.shape
    bins, dtype, shape = images.shape[3], images.dtype, _shape(images, scheme)
    lines = shape.high * shape.line
    x, grad, unit = np.zeros(lines, dtype), np.zeros(lines, dtype), np.zeros(lines, dtype)
    of_cells = np.empty(images.shape[1] * images.shape[2], dtype)
    for image in range(start, stop):
        histograms, of_image, to = (
            images[image].reshape(-1),
            grad_output[image].reshape(-1),
            grad_input[image].reshape(-1),
        )
        to[:] = 0
        begin = 0
        _sums_of_cells(histograms, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                first, left = row * scheme.down, col * scheme.across
                at = first * shape.row_size + left * bins
                _read_rows(histograms, at, shape.row_size, shape, x)
                _read_rows(of_image, begin, shape.row, shape, grad)
                _block_vjp(x, grad, _sum_of_block(of_cells, first, left, images.shape[2], scheme), scheme, unit)
                for k in range(shape.high):
                    add(unit, k * shape.line, shape.row, to, at + k * shape.row_size)
                begin += size
