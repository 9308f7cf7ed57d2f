"""Where the cells of a descriptor are in its image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..inputs.boxes import Box, as_box
from ..inputs.numbers import as_size
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
    centres = []
    for axis, count in enumerate(spec.grid(*as_size("image_size", image_size))):
        first, step, side = _spacing(spec, axis)
        centres.append(first + step * np.arange(count, dtype=np.float64) + (side - 1) / 2)
    y, x = centres
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
    image_size = as_size("image_size", image_size)
    rows, cols = spec.grid(*image_size)
    x0, y0, x1, y1 = as_box("cells", cells)
    spans = []
    for axis, (count, begin, end) in enumerate(((rows, y0, y1), (cols, x0, x1))):
        if not 0 <= begin < end <= count:
            raise ValueError(f"a window must hold some of the descriptor's {rows} rows and {cols} columns, got {cells}")
        first, step, side = _spacing(spec, axis)
        spans.append((first + step * int(begin), min(first + step * (int(end) - 1) + side, image_size[axis])))
    (top, bottom), (left, right) = spans
    return Box(left, top, right, bottom)


def _spacing(spec: HOGSpec, axis: int) -> tuple[int, int, int]:
    """For rows (axis 0) or columns: first pixel of the first one, distance to the next, size of each."""
    cell, (step, extent, margin) = spec.cell_size[axis], spec.normalizer.footprint(axis)
    first, following, last = (
        spec.pooling.first_pixel(index, cell, axis) for index in (margin, margin + step, margin + extent - 1)
    )
    return first, following - first, last + cell - first
