"""The normalisers of a whole image and of each cell, compiled, with their vjps.

Histograms and descriptors are (images, rows, cols, bins); a loop goes over images ``start`` to ``stop`` of them.
"""

from __future__ import annotations

import math

import numpy as np

from ...runtime.arrays import Floats, Real
from ...runtime.compile import compiled, inlined


@inlined
def copy(source: Floats, begin: int, count: int, out: Floats, to: int) -> None:
    """``out[to:]`` = ``source[begin:]``, so many numbers."""
    first, place = np.uintp(begin), np.uintp(to)
    for k in range(count):
        out[place + np.uintp(k)] = source[first + np.uintp(k)]


@inlined
def dot(left: Floats, at: int, right: Floats, begin: int, count: int) -> Real:
    """The dot product of ``count`` numbers, in four sums that do not wait for each other."""
    zero = left.dtype.type(0)
    a, b, c, d = zero, zero, zero, zero
    one, two, three = np.uintp(1), np.uintp(2), np.uintp(3)
    whole = count // 4 * 4
    for k in range(0, whole, 4):
        x, y = np.uintp(at) + np.uintp(k), np.uintp(begin) + np.uintp(k)
        a += left[x] * right[y]
        b += left[x + one] * right[y + one]
        c += left[x + two] * right[y + two]
        d += left[x + three] * right[y + three]
    total: Real = (a + b) + (c + d)
    for k in range(whole, count):
        total += left[np.uintp(at) + np.uintp(k)] * right[np.uintp(begin) + np.uintp(k)]
    return total


@compiled
def long_dot(left: Floats, right: Floats) -> float:
    """The dot product of long vectors: one sum in float32 would lose digits."""
    total = 0.0
    for first in range(0, left.size, 256):
        total += np.float64(dot(left, first, right, first, min(256, left.size - first)))
    return total


@compiled
def global_norm(images: Floats, scheme: tuple[float, bool], start: int, stop: int, out: Floats) -> None:
    """Eq. 7: see :meth:`nablahog.hog.GlobalNorm.normalize`."""
    epsilon, robust = scheme
    for image in range(start, stop):
        histograms, to = images[image].reshape(-1), out[image].reshape(-1)
        energy = long_dot(histograms, histograms)
        length = energy + epsilon * epsilon if robust else math.sqrt(energy) + epsilon
        factor = images.dtype.type(1 / math.sqrt(length))
        for k in range(to.size):
            to[k] = histograms[k] * factor


@compiled
def global_norm_vjp(
    images: Floats, scheme: tuple[float, bool], grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """f · ȳ + f' · ⟨x, ȳ⟩ · x, with f the factor of :func:`global_norm`."""
    epsilon, robust = scheme
    for image in range(start, stop):
        x, y = images[image].reshape(-1), grad_output[image].reshape(-1)
        to = grad_input[image].reshape(-1)
        energy, product = long_dot(x, x), long_dot(x, y)
        if robust:
            factor = 1 / math.sqrt(energy + epsilon * epsilon)
            slope = -(factor * factor * factor) * product
        else:
            size = math.sqrt(energy)
            factor = 1 / math.sqrt(size + epsilon)
            slope = -0.5 * factor * factor * factor * product / size if size > 0 else 0.0
        by_output, by_input = images.dtype.type(factor), images.dtype.type(slope)
        for k in range(to.size):
            to[k] = y[k] * by_output + x[k] * by_input


@compiled
def cell_norm(images: Floats, epsilon: Real, start: int, stop: int, out: Floats) -> None:
    """Each cell by itself: see :meth:`nablahog.hog.CellNorm.normalize`."""
    for image in range(start, stop):
        for row in range(out.shape[1]):
            for col in range(out.shape[2]):
                cell = images[image, row, col]
                length: Real | float = math.sqrt(dot(cell, 0, cell, 0, cell.size))
                length = length if length > epsilon else epsilon
                for k in range(cell.size):
                    out[image, row, col, k] = cell[k] / length


@compiled
def cell_norm_vjp(
    images: Floats, epsilon: Real, grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """Its vjp; where a cell is exactly as long as ε, the mean of both sides."""
    real = images.dtype.type
    for image in range(start, stop):
        for row in range(images.shape[1]):
            for col in range(images.shape[2]):
                cell, grad = images[image, row, col], grad_output[image, row, col]
                length: Real | float = math.sqrt(dot(cell, 0, cell, 0, cell.size))
                share = real(1) if length > epsilon else real(0.5) if length == epsilon else real(0)
                length = length if length > epsilon else epsilon
                product = dot(cell, 0, grad, 0, cell.size)
                slope = share * product / length / length / length if share > 0 else real(0)
                for k in range(cell.size):
                    grad_input[image, row, col, k] = grad[k] / length - slope * cell[k]
