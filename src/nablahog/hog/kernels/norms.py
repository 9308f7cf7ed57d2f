"""The normalisers of a whole image and of each cell, compiled, with their vjps.

Histograms and descriptors are (images, rows, cols, bins); a loop goes over images ``start`` to ``stop`` of them.
"""

from __future__ import annotations

import math

import numpy as np

from ...runtime.arrays import Floats, Real
from ...runtime.compile import borrowing, inlined
from .norm_simd import dot


@inlined
def whole_eights(count: int) -> int:
    """The size of a line for so many numbers: see :mod:`.norm_simd`."""
    return (count + 7) // 8 * 8


@borrowing
def long_dot(left: Floats, right: Floats) -> float:
    """The dot product of long vectors: one sum in float32 would lose digits."""
    total = 0.0
    for first in range(0, left.size, 256):
        total += np.float64(dot(left, first, right, first, min(256, left.size - first)))
    return total


@borrowing
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


@borrowing
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


@borrowing
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


@borrowing
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
