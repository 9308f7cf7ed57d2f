"""Rows and columns of a descriptor to pixels of the image, and the inverse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .box import Box
from .spec import HOGSpec


def cell_centres(spec: HOGSpec, image_size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of a descriptor's rows and columns, which are cells or blocks, in the image.

    Args:
        spec: the dialect.
        image_size: (height, width) of the image.

    Returns:
        y of each row and x of each column, in pixels; 0 is the middle of the first pixel, as where ``imshow`` draws it.

    Raises:
        ValueError: the image has no descriptor.
    """
    rows, cols = spec.grid(*image_size)
    y, x = (
        first + step * np.arange(n, dtype=np.float64) + (side - 1) / 2
        for n, (first, step, side) in zip((rows, cols), _spacing(spec), strict=True)
    )
    return y, x


def pixel_box(spec: HOGSpec, image_size: tuple[int, int], cells: Sequence[float]) -> Box:
    """The pixels of the cells, or blocks, in a window of a descriptor's rows and columns.

    More pixels matter for its entries: gradients are differences of neighbours, bilinear votes reach half a cell
    further, and normalisers may depend on the cells around.

    Args:
        spec: the dialect.
        image_size: (height, width) of the image.
        cells: the window: x counts columns of the descriptor, y its rows, of cells or blocks.

    Returns:
        The box in pixels of the image, in which a last cell may be cut.

    Raises:
        ValueError: the window is empty or not within the descriptor.
    """
    spans = []
    for begins, ends, (first, last) in zip(*_edges(spec, image_size), _sides(cells), strict=True):
        if not 0 <= first < last <= len(begins):
            rows, cols = spec.grid(*image_size)
            raise ValueError(f"a window must hold some of the descriptor's {rows} rows and {cols} columns, got {cells}")
        spans.append((int(begins[int(first)]), int(ends[int(last) - 1])))
    (y0, y1), (x0, x1) = spans
    return Box(x0, y0, x1, y1)


def _sides(box: Sequence[float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """First and last row, first and last column; the last are excluded."""
    x0, y0, x1, y1 = Box.of(box)
    return (y0, y1), (x0, x1)


def _spacing(spec: HOGSpec) -> list[tuple[int, int, int]]:
    """Of rows and of columns: the first pixel of the first, pixels from one to the next, pixels of each."""
    return [_along(spec, axis) for axis in (0, 1)]


def _along(spec: HOGSpec, axis: int) -> tuple[int, int, int]:
    cell, (step, extent, margin) = spec.cell_size[axis], spec.normalizer.footprint(axis)
    first, following, last = (
        spec.pooling.first_pixel(index, cell, axis) for index in (margin, margin + step, margin + extent - 1)
    )
    return first, following - first, last + cell - first


def _edges(spec: HOGSpec, image_size: tuple[int, int]) -> tuple[list[NDArray[np.int64]], list[NDArray[np.int64]]]:
    """Where each row, and each column, begins and ends, cut by the image."""
    begins, ends = [], []
    for n, pixels, (first, step, side) in zip(spec.grid(*image_size), image_size, _spacing(spec), strict=True):
        begins.append(first + step * np.arange(n))
        ends.append(np.minimum(begins[-1] + side, pixels))
    return begins, ends
