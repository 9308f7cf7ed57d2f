"""Boxes of pixels or of cells, in one order of coordinates everywhere, and where a descriptor's cells are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .spec import HOGSpec


class Box(NamedTuple):
    """A half-open rectangle, x0 ≤ x < x1 and y0 ≤ y < y1, in pixels of an image or in cells of a descriptor.

    x counts columns to the right, y rows downwards, both from the upper left corner: all is (0, 0, width, height).
    PASCAL's boxes, which count from 1 and include both ends, are converted where they are read.
    """

    x0: float
    y0: float
    x1: float
    y1: float

    @classmethod
    def of(cls, sides: Iterable[float]) -> Box:
        """The box of x0, y0, x1, y1 in a tuple, a list or an array.

        Raises:
            ValueError: these are not four numbers.
        """
        sides = tuple(sides)
        if len(sides) != 4:
            raise ValueError(f"a box must be four numbers x0, y0, x1, y1, got {sides}")
        return cls(*sides)

    @property
    def width(self) -> float:
        """x1 − x0."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """y1 − y0."""
        return self.y1 - self.y0

    @property
    def rows(self) -> slice:
        """Index of its rows in an array; y0 and y1 are integers."""
        return slice(self.y0, self.y1)

    @property
    def cols(self) -> slice:
        """Index of its columns in an array; x0 and x1 are integers."""
        return slice(self.x0, self.x1)

    def intersect(self, other: Box) -> Box:
        """The intersection; its width or height is 0 or less if it is empty."""
        return Box(max(self.x0, other.x0), max(self.y0, other.y0), min(self.x1, other.x1), min(self.y1, other.y1))

    def iou(self, other: Box) -> float:
        """Area of the intersection over area of the union, in 0…1; 0 if both are empty."""
        common = self.intersect(other)
        shared = max(0.0, common.width) * max(0.0, common.height)
        areas = self.width * self.height + other.width * other.height
        return shared / (areas - shared) if areas > shared else 0.0


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
    for axis, count in enumerate(spec.grid(*image_size)):
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
    rows, cols = spec.grid(*image_size)
    x0, y0, x1, y1 = Box.of(cells)
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
