"""The normalisers of a whole image, of blocks and of cells compiled: vectors to vectors, and their adjoints.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...runtime.compile import compiled, inlined
from ..normalizers import BlockNorm
from .block_norm_simd import (
    add_normalised_vjp,
    clip_block,
    clip_vjp,
    clipped_products,
    product,
    root_block,
    root_vjp,
    scale_block,
)
from .four_block_simd import dot_eight

_L1, _L1_SQRT, _L2, _L2_HYS = range(4)


class Blocks(NamedTuple):
    """What the loops need to know of a :class:`.normalizers.BlockNorm`."""

    high: int
    wide: int
    down: int
    across: int
    form: int
    epsilon: Any
    epsilon_again: Any
    added: bool
    clip: Any


def rectangles(scheme: BlockNorm, real: Any) -> Blocks:
    """In float32 or float64, ``real``."""
    form = {"L1": _L1, "L1-sqrt": _L1_SQRT, "L2": _L2, "L2-Hys": _L2_HYS}[scheme.form]
    epsilons = real(scheme.epsilon), real(scheme.epsilon_again)
    return Blocks(*scheme.block, *scheme.step, form, *epsilons, scheme.epsilon_outside_root, real(scheme.clip))


@inlined
def copy(source: Any, begin: int, count: int, found: Any, to: int) -> None:
    """``found[to:]`` = ``source[begin:]``, so many numbers."""
    first, place = np.uintp(begin), np.uintp(to)
    for k in range(count):
        found[place + np.uintp(k)] = source[first + np.uintp(k)]


@inlined
def _product(left: Any, right: Any) -> Any:
    """The dot product."""
    total = left.dtype.type(0)
    whole = left.size // 8 * 8
    for k in range(0, whole, 8):
        total += dot_eight(left, k, right, k)
    for k in range(whole, left.size):
        total += left[k] * right[k]
    return total


@compiled
def _total(left: Any, right: Any) -> float:
    """The dot product of long vectors: sums of float32 would lose digits."""
    total = 0.0
    for first in range(0, left.size, 256):
        total += np.float64(_product(left[first : first + 256], right[first : first + 256]))
    return total


@compiled
def global_norm(images: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Eq. 7 for images ``start`` to ``stop``: see :meth:`nablahog.hog.GlobalNorm.normalize`."""
    epsilon, robust = scheme
    for image in range(start, stop):
        histograms, to = images[image].reshape(-1), found[image].reshape(-1)
        energy = _total(histograms, histograms)
        length = energy + epsilon * epsilon if robust else math.sqrt(energy) + epsilon
        factor = images.dtype.type(1 / math.sqrt(length))
        for k in range(to.size):
            to[k] = histograms[k] * factor


@compiled
def global_norm_vjp(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """Its adjoint."""
    epsilon, robust = scheme
    for image in range(start, stop):
        histograms, reached, to = images[image].reshape(-1), given[image].reshape(-1), found[image].reshape(-1)
        energy, product = _total(histograms, histograms), _total(histograms, reached)
        if robust:
            factor = 1 / math.sqrt(energy + epsilon * epsilon)
            slope = -(factor * factor * factor) * product
        else:
            size = math.sqrt(energy)
            factor = 1 / math.sqrt(size + epsilon)
            slope = -0.5 * factor * factor * factor * product / size if size > 0 else 0.0
        by_given, by_own = images.dtype.type(factor), images.dtype.type(slope)
        for k in range(to.size):
            to[k] = reached[k] * by_given + histograms[k] * by_own


@compiled
def cell_norm(images: Any, epsilon: Any, start: int, stop: int, found: Any) -> None:
    """Each cell for itself: see :meth:`nablahog.hog.CellNorm.normalize`."""
    for image in range(start, stop):
        for row in range(found.shape[1]):
            for col in range(found.shape[2]):
                cell = images[image, row, col]
                length = math.sqrt(_product(cell, cell))
                length = length if length > epsilon else epsilon
                for k in range(cell.size):
                    found[image, row, col, k] = cell[k] / length


@compiled
def cell_norm_vjp(images: Any, epsilon: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """Its adjoint; where a cell is exactly as long as ε, the mean of both sides."""
    real = images.dtype.type
    for image in range(start, stop):
        for row in range(found.shape[1]):
            for col in range(found.shape[2]):
                cell, reached = images[image, row, col], given[image, row, col]
                length = math.sqrt(_product(cell, cell))
                share = real(1) if length > epsilon else real(0.5) if length == epsilon else real(0)
                length = length if length > epsilon else epsilon
                slope = share * _product(cell, reached) / length / length / length if share > 0 else real(0)
                for k in range(cell.size):
                    found[image, row, col, k] = reached[k] / length - slope * cell[k]


@inlined
def _of_cells(histograms: Any, cells: int, bins: int, squares: bool, found: Any) -> None:
    """For each cell, the sum of its bins, or of their squares."""
    for cell in range(cells):
        of_cell = histograms[cell * bins : (cell + 1) * bins]
        if squares:
            found[cell] = _product(of_cell, of_cell)
        else:
            total = of_cell[0]
            for k in range(1, bins):
                total += of_cell[k]
            found[cell] = total


@inlined
def _of_block(of_cells: Any, row: int, col: int, high: int, wide: int, cols: int) -> Any:
    """The sum of what the cells of a block have."""
    total = of_cells[0] - of_cells[0]
    for y in range(row, row + high):
        for x in range(col, col + wide):
            total += of_cells[y * cols + x]
    return total


@inlined
def _factor(energy: Any, epsilon: Any, added: bool) -> Any:
    """By which L2 multiplies."""
    one = epsilon / epsilon
    return one / (math.sqrt(energy) + epsilon if added else math.sqrt(energy + epsilon * epsilon))


@inlined
def _slope(energy: Any, product: Any, epsilon: Any, added: bool) -> Any:
    """The number times which its adjoint subtracts a vector, of whose products with what reaches it that is the sum."""
    factor = _factor(energy, epsilon, added)
    if not added:
        return factor * factor * factor * product
    return factor * factor * product / math.sqrt(energy) if energy > 0 else energy


@inlined
def _gather(histograms: Any, begin: int, of_row: int, count: int, high: int, vector: Any) -> None:
    """``high`` rows of a block, each ``count`` numbers, from ``histograms[begin:]``; image rows are ``of_row`` long."""
    for row in range(high):
        copy(histograms, begin + row * of_row, count, vector, row * count)


@compiled
def block_norm(images: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Histograms to blocks: see :meth:`nablahog.hog.BlockNorm.normalize`."""
    _, rows, cols, size = found.shape
    cells, bins = images.shape[1] * images.shape[2], images.shape[3]
    of_row, count, high = images.shape[2] * bins, scheme.wide * bins, scheme.high
    short = count < 8
    whole = (size + 7) // 8 * 8
    vector, block = np.zeros(whole, images.dtype), np.zeros(whole, images.dtype)
    described = np.zeros(whole, images.dtype)
    of_cells = np.empty(cells, images.dtype)
    for image in range(start, stop):
        histograms, of_image, to = images[image].reshape(-1), found[image].reshape(-1), 0
        _of_cells(histograms, cells, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                y, x = row * scheme.down, col * scheme.across
                total = _of_block(of_cells, y, x, high, scheme.wide, images.shape[2])
                source, shape, target, place = histograms, (y * of_row + x * bins, of_row, high, count), of_image, to
                if short:
                    _gather(histograms, shape[0], of_row, count, high, vector)
                    source, shape, target, place = vector, (0, 0, 1, whole), described, 0
                if scheme.form == _L2_HYS:
                    factor = _factor(total, scheme.epsilon, scheme.added)
                    energy = clip_block(source, *shape, factor, scheme.clip, block)
                    factor = _factor(energy, scheme.epsilon_again, scheme.added)
                    scale_block(block, 0, 0, 1, shape[2] * shape[3], factor, target, place)
                elif scheme.form == _L2:
                    scale_block(source, *shape, _factor(total, scheme.epsilon, scheme.added), target, place)
                else:
                    factor = scheme.epsilon / scheme.epsilon / (total + scheme.epsilon)
                    if scheme.form == _L1:
                        scale_block(source, *shape, factor, target, place)
                    else:
                        root_block(source, *shape, factor, target, place)
                if short:
                    copy(described, 0, size, of_image, to)
                to += size


@compiled
def block_norm_vjp(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """Its adjoint."""
    _, rows, cols, size = given.shape
    cells, bins = images.shape[1] * images.shape[2], images.shape[3]
    of_row, count, high = images.shape[2] * bins, scheme.wide * bins, scheme.high
    short = count < 8
    whole = (size + 7) // 8 * 8
    one = scheme.epsilon / scheme.epsilon
    zero = one - one
    vector, of_vector, back = (
        np.zeros(whole, images.dtype),
        np.zeros(whole, images.dtype),
        np.zeros(whole, images.dtype),
    )
    through, totals = np.zeros(whole, images.dtype), np.zeros(2, images.dtype)
    of_cells = np.empty(cells, images.dtype)
    for image in range(start, stop):
        histograms, of_image, to_all = images[image].reshape(-1), given[image].reshape(-1), found[image].reshape(-1)
        to_all[:] = 0
        begin = 0
        _of_cells(histograms, cells, bins, scheme.form >= _L2, of_cells)
        for row in range(rows):
            for col in range(cols):
                y, x = row * scheme.down, col * scheme.across
                total = _of_block(of_cells, y, x, high, scheme.wide, images.shape[2])
                at = y * of_row + x * bins
                source, shape, reached, first, target = histograms, (at, of_row, high, count), of_image, begin, to_all
                if short:
                    _gather(histograms, at, of_row, count, high, vector)
                    copy(of_image, begin, size, of_vector, 0)
                    back[:] = 0
                    source, shape, reached, first, target = vector, (0, 0, 1, whole), of_vector, 0, back
                if scheme.form >= _L2:
                    factor = _factor(total, scheme.epsilon, scheme.added)
                    if scheme.form == _L2_HYS:
                        clipped_products(source, *shape, factor, scheme.clip, reached, first, totals)
                        again = scheme.epsilon_again, scheme.added
                        by_given, by_own = _factor(totals[0], *again), _slope(totals[0], totals[1], *again)
                        sum_ = clip_vjp(source, *shape, factor, scheme.clip, reached, first, by_given, by_own, through)
                        reached, first = through, 0
                    else:
                        sum_ = product(source, *shape, reached, first)
                    slope = _slope(total, sum_, scheme.epsilon, scheme.added)
                    add_normalised_vjp(source, *shape, reached, first, factor, slope, zero, target)
                else:
                    factor = one / (total + scheme.epsilon)
                    if scheme.form == _L1_SQRT:
                        sum_ = root_vjp(source, *shape, factor, reached, first, through)
                        reached, first = through, 0
                    else:
                        sum_ = product(source, *shape, reached, first)
                    add_normalised_vjp(source, *shape, reached, first, factor, zero, factor * factor * sum_, target)
                if short:
                    _add_rows(back, at, of_row, count, high, to_all)
                begin += size


@inlined
def _add_rows(vector: Any, begin: int, of_row: int, count: int, high: int, found: Any) -> None:
    """Adds the block to where it came from."""
    for row in range(high):
        at, first = np.uintp(begin + row * of_row), np.uintp(row * count)
        for k in range(count):
            found[at + np.uintp(k)] += vector[first + np.uintp(k)]
