"""The normalisers of a whole image, of blocks and of cells compiled: vectors to vectors, and their adjoints.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compile import compiled
from ..normalizers import BlockNorm
from .eights import dot_eight

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
    return Blocks(*scheme.block, *scheme.step, form, *epsilons, scheme.added, real(scheme.clip))


@compiled
def copy(source: Any, begin: int, count: int, found: Any, to: int) -> None:
    """``found[to:]`` = ``source[begin:]``, so many numbers."""
    first, place = np.uintp(begin), np.uintp(to)
    for k in range(count):
        found[place + np.uintp(k)] = source[first + np.uintp(k)]


@compiled
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
    """Eq. 7 for images ``start`` to ``stop``: see :func:`nablahog.hog.normalize.global_norm`."""
    epsilon, robust = scheme
    for image in range(start, stop):
        histograms, to = images[image].reshape(-1), found[image].reshape(-1)
        energy = _total(histograms, histograms)
        length = energy + epsilon * epsilon if robust else math.sqrt(energy) + epsilon
        factor = images.dtype.type(1 / math.sqrt(length))
        for k in range(to.size):
            to[k] = histograms[k] * factor


@compiled
def global_adjoint(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
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
    """Each cell for itself: see :func:`nablahog.hog.normalize.cell_norm`."""
    for image in range(start, stop):
        for row in range(found.shape[1]):
            for col in range(found.shape[2]):
                cell = images[image, row, col]
                length = math.sqrt(_product(cell, cell))
                length = length if length > epsilon else epsilon
                for k in range(cell.size):
                    found[image, row, col, k] = cell[k] / length


@compiled
def cell_adjoint(images: Any, epsilon: Any, given: Any, start: int, stop: int, found: Any) -> None:
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


@compiled
def _unit(vector: Any, epsilon: Any, added: bool, found: Any) -> None:
    """L2 of one block, which is padded to whole eights with zeros."""
    one = vector.dtype.type(1)
    energy = _product(vector, vector)
    factor = one / (math.sqrt(energy) + epsilon if added else math.sqrt(energy + epsilon * epsilon))
    for k in range(vector.size):
        found[k] = vector[k] * factor


@compiled
def _unit_adjoint(vector: Any, epsilon: Any, added: bool, given: Any, found: Any) -> None:
    """Its adjoint; ``found`` may be ``given``."""
    one = vector.dtype.type(1)
    energy, product = _product(vector, vector), _product(vector, given)
    size = math.sqrt(energy)
    if added:
        factor = one / (size + epsilon)
        slope = factor * factor * product / size if size > 0 else one - one
    else:
        factor = one / math.sqrt(energy + epsilon * epsilon)
        slope = factor * factor * factor * product
    for k in range(vector.size):
        found[k] = given[k] * factor - vector[k] * slope


@compiled
def _block(vector: Any, ones: Any, scheme: Any, found: Any) -> None:
    """One block's vector to its descriptor, which must not share memory with it."""
    if scheme.form <= _L1_SQRT:
        factor = vector.dtype.type(1) / (_product(vector, ones) + scheme.epsilon)
        for k in range(vector.size):
            found[k] = vector[k] * factor
        if scheme.form == _L1_SQRT:
            for k in range(vector.size):
                found[k] = math.sqrt(found[k])
        return
    _unit(vector, scheme.epsilon, scheme.added, found)
    if scheme.form == _L2_HYS:
        for k in range(vector.size):
            found[k] = scheme.clip if found[k] > scheme.clip else found[k]
        _unit(found, scheme.epsilon_again, scheme.added, found)


@compiled
def _block_adjoint(vector: Any, ones: Any, scheme: Any, given: Any, unit: Any, clipped: Any, found: Any) -> None:
    """Its adjoint; ``unit`` and ``clipped`` are overwritten."""
    real = vector.dtype.type
    half, zero = real(0.5), real(0)
    if scheme.form <= _L1_SQRT:
        factor = real(1) / (_product(vector, ones) + scheme.epsilon)
        for k in range(vector.size):
            reached = given[k]
            if scheme.form == _L1_SQRT:
                root = math.sqrt(vector[k] * factor)
                reached = half * reached / root if root > zero else zero
            found[k] = reached
        total = factor * _product(found, vector)
        for k in range(vector.size):
            found[k] = factor * (found[k] - total)
        return
    if scheme.form == _L2:
        _unit_adjoint(vector, scheme.epsilon, scheme.added, given, found)
        return
    _unit(vector, scheme.epsilon, scheme.added, unit)
    for k in range(vector.size):
        clipped[k] = scheme.clip if unit[k] > scheme.clip else unit[k]
    _unit_adjoint(clipped, scheme.epsilon_again, scheme.added, given, found)
    for k in range(vector.size):  # at the clip itself, the mean of both sides
        passed = half * found[k] if unit[k] == scheme.clip else found[k]
        found[k] = zero if unit[k] > scheme.clip else passed
    _unit_adjoint(vector, scheme.epsilon, scheme.added, found, found)


@compiled
def _gather(histograms: Any, begin: int, of_row: int, count: int, high: int, vector: Any) -> None:
    """``high`` rows of a block, each ``count`` numbers, from ``histograms[begin:]``; image rows are ``of_row`` long."""
    for row in range(high):
        at = begin + row * of_row
        copy(histograms, at, count, vector, row * count)


@compiled
def _add_back(vector: Any, begin: int, of_row: int, count: int, high: int, found: Any) -> None:
    """The adjoint: adds the block to where it came from."""
    for row in range(high):
        at, first = np.uintp(begin + row * of_row), np.uintp(row * count)
        for k in range(count):
            found[at + np.uintp(k)] += vector[first + np.uintp(k)]


@compiled
def block_norm(images: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Histograms to blocks: see :func:`nablahog.hog.normalize.block_norm`."""
    _, rows, cols, size = found.shape
    of_row, count = images.shape[2] * images.shape[3], scheme.wide * images.shape[3]
    padded = (size + 7) // 8 * 8
    vector, ones, block = np.zeros(padded, images.dtype), np.ones(padded, images.dtype), np.empty(padded, images.dtype)
    for image in range(start, stop):
        histograms, to, at = images[image].reshape(-1), found[image].reshape(-1), 0
        for row in range(rows):
            for col in range(cols):
                begin = row * scheme.down * of_row + col * scheme.across * images.shape[3]
                _gather(histograms, begin, of_row, count, scheme.high, vector)
                _block(vector, ones, scheme, block)
                copy(block, 0, size, to, at)
                at += size


@compiled
def block_adjoint(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """Its adjoint."""
    _, rows, cols, size = given.shape
    of_row, count = images.shape[2] * images.shape[3], scheme.wide * images.shape[3]
    padded = (size + 7) // 8 * 8
    vector, ones, block = np.zeros(padded, images.dtype), np.ones(padded, images.dtype), np.zeros(padded, images.dtype)
    unit, clipped, to_block = (
        np.empty(padded, images.dtype),
        np.empty(padded, images.dtype),
        np.empty(padded, images.dtype),
    )
    for image in range(start, stop):
        histograms, to = images[image].reshape(-1), found[image].reshape(-1)
        reached, at = given[image].reshape(-1), 0
        to[:] = 0
        for row in range(rows):
            for col in range(cols):
                begin = row * scheme.down * of_row + col * scheme.across * images.shape[3]
                _gather(histograms, begin, of_row, count, scheme.high, vector)
                copy(reached, at, size, block, 0)
                _block_adjoint(vector, ones, scheme, block, unit, clipped, to_block)
                _add_back(to_block, begin, of_row, count, scheme.high, to)
                at += size
