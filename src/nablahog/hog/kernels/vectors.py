"""The normalisers of a whole image, of blocks and of cells compiled: vectors to vectors, and their adjoints.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compile import compiled
from ..normalizers import BlockNorm

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
def _energy(entries: Any) -> Any:
    """The sum of squares, four at a time."""
    zero = entries.dtype.type(0)
    a, b, c, d = zero, zero, zero, zero
    whole = entries.size // 4 * 4
    for k in range(0, whole, 4):
        a += entries[k] * entries[k]
        b += entries[k + 1] * entries[k + 1]
        c += entries[k + 2] * entries[k + 2]
        d += entries[k + 3] * entries[k + 3]
    for k in range(whole, entries.size):
        a += entries[k] * entries[k]
    return (a + b) + (c + d)


@compiled
def _product(left: Any, right: Any) -> Any:
    """The dot product, four at a time."""
    zero = left.dtype.type(0)
    a, b, c, d = zero, zero, zero, zero
    whole = left.size // 4 * 4
    for k in range(0, whole, 4):
        a += left[k] * right[k]
        b += left[k + 1] * right[k + 1]
        c += left[k + 2] * right[k + 2]
        d += left[k + 3] * right[k + 3]
    for k in range(whole, left.size):
        a += left[k] * right[k]
    return (a + b) + (c + d)


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
                length = math.sqrt(_energy(cell))
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
                length = math.sqrt(_energy(cell))
                share = real(1) if length > epsilon else real(0.5) if length == epsilon else real(0)
                length = length if length > epsilon else epsilon
                slope = share * _product(cell, reached) / length / length / length if share > 0 else real(0)
                for k in range(cell.size):
                    found[image, row, col, k] = reached[k] / length - slope * cell[k]


@compiled
def _unit(vector: Any, epsilon: Any, added: bool, found: Any) -> None:
    """L2 of one block."""
    one = vector.dtype.type(1)
    energy = _energy(vector)
    factor = one / (math.sqrt(energy) + epsilon if added else math.sqrt(energy + epsilon * epsilon))
    for k in range(vector.size):
        found[k] = vector[k] * factor


@compiled
def _unit_adjoint(vector: Any, epsilon: Any, added: bool, given: Any, found: Any) -> None:
    """Its adjoint; ``found`` may be ``given``."""
    one = vector.dtype.type(1)
    energy, product = _energy(vector), _product(vector, given)
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
def _sum(vector: Any) -> Any:
    total = vector.dtype.type(0)
    for k in range(vector.size):
        total += vector[k]
    return total


@compiled
def _block(vector: Any, scheme: Any, found: Any) -> None:
    """One block's vector to its descriptor, which must not share memory with it."""
    if scheme.form <= _L1_SQRT:
        factor = vector.dtype.type(1) / (_sum(vector) + scheme.epsilon)
        for k in range(vector.size):
            found[k] = vector[k] * factor
            if scheme.form == _L1_SQRT:
                found[k] = math.sqrt(found[k])
        return
    _unit(vector, scheme.epsilon, scheme.added, found)
    if scheme.form == _L2_HYS:
        for k in range(vector.size):
            found[k] = scheme.clip if found[k] > scheme.clip else found[k]
        _unit(found, scheme.epsilon_again, scheme.added, found)


@compiled
def _block_adjoint(vector: Any, scheme: Any, given: Any, unit: Any, clipped: Any, found: Any) -> None:
    """Its adjoint; ``unit`` and ``clipped`` are overwritten."""
    real = vector.dtype.type
    if scheme.form <= _L1_SQRT:
        factor = real(1) / (_sum(vector) + scheme.epsilon)
        total = real(0)
        for k in range(vector.size):
            reached = given[k]
            if scheme.form == _L1_SQRT:
                root = math.sqrt(vector[k] * factor)
                reached = real(0.5) * reached / root if root > 0 else real(0)
            found[k] = reached
            total += reached * vector[k]
        for k in range(vector.size):
            found[k] = factor * (found[k] - factor * total)
        return
    if scheme.form == _L2:
        _unit_adjoint(vector, scheme.epsilon, scheme.added, given, found)
        return
    _unit(vector, scheme.epsilon, scheme.added, unit)
    for k in range(vector.size):
        clipped[k] = scheme.clip if unit[k] > scheme.clip else unit[k]
    _unit_adjoint(clipped, scheme.epsilon_again, scheme.added, given, found)
    for k in range(vector.size):
        if unit[k] > scheme.clip:
            found[k] = 0
        elif unit[k] == scheme.clip:  # the mean of both sides
            found[k] *= real(0.5)
    _unit_adjoint(vector, scheme.epsilon, scheme.added, found, found)


@compiled
def _gather(histograms: Any, row: int, col: int, scheme: Any, vector: Any) -> None:
    """The cells of a block, row by row."""
    bins, k = histograms.shape[2], 0
    for y in range(row, row + scheme.high):
        for x in range(col, col + scheme.wide):
            for bin_ in range(bins):
                vector[k + bin_] = histograms[y, x, bin_]
            k += bins


@compiled
def block_norm(images: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Histograms to blocks: see :func:`nablahog.hog.normalize.block_norm`."""
    _, rows, cols, size = found.shape
    vector = np.empty(size, images.dtype)
    for image in range(start, stop):
        for row in range(rows):
            for col in range(cols):
                _gather(images[image], row * scheme.down, col * scheme.across, scheme, vector)
                _block(vector, scheme, found[image, row, col])


@compiled
def block_adjoint(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """Its adjoint."""
    _, rows, cols, size = given.shape
    bins = images.shape[3]
    vector, reached = np.empty(size, images.dtype), np.empty(size, images.dtype)
    unit, clipped = np.empty(size, images.dtype), np.empty(size, images.dtype)
    for image in range(start, stop):
        to = found[image]
        to[:] = 0
        for row in range(rows):
            for col in range(cols):
                top, left, k = row * scheme.down, col * scheme.across, 0
                _gather(images[image], top, left, scheme, vector)
                _block_adjoint(vector, scheme, given[image, row, col], unit, clipped, reached)
                for y in range(top, top + scheme.high):
                    for x in range(left, left + scheme.wide):
                        for bin_ in range(bins):
                            to[y, x, bin_] += reached[k + bin_]
                        k += bins
