"""Boxes of pixels or of cells, in one order of coordinates everywhere."""

from __future__ import annotations

from typing import NamedTuple

from .numbers import as_numbers, as_plain


class Box(NamedTuple):
    """A half-open rectangle, x0 ≤ x < x1 and y0 ≤ y < y1, in pixels of an image or in cells of a descriptor.

    x counts columns to the right, y rows downwards, both from the upper left corner: all is (0, 0, width, height).
    PASCAL's boxes, which count from 1 and include both ends, are converted where they are read.
    """

    x0: float
    y0: float
    x1: float
    y1: float

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

    def widen(self, least: float) -> Box:
        """The box around the same middle with sides of at least ``least``."""
        across, down = (max(0.0, least - side) / 2 for side in (self.width, self.height))
        return Box(self.x0 - across, self.y0 - down, self.x1 + across, self.y1 + down)

    def iou(self, other: Box) -> float:
        """Area of the intersection over area of the union, in 0…1; 0 if both are empty."""
        common = self.intersect(other)
        shared = max(0.0, common.width) * max(0.0, common.height)
        areas = self.width * self.height + other.width * other.height
        return shared / (areas - shared) if areas > shared else 0.0


def as_box(name: str, box: object) -> Box:
    """The box of four numbers x0, y0, x1, y1 in a tuple, a list, an array or a tensor.

    Raises:
        ValueError: these are not four finite numbers.
    """
    plain = as_plain(box)
    write = ""
    if isinstance(plain, tuple) and len(plain) > 4:  # with confidence and class
        write = ": write box[:4] of a detector's row"
    elif isinstance(plain, tuple) and plain and isinstance(plain[0], tuple):
        write = ": write each row in a call of its own" if len(plain[0]) == 4 else ": write np.ravel(box)"
    try:
        return Box(*as_numbers(name, box, "x0, y0, x1, y1"))
    except ValueError as error:
        raise ValueError(f"{error}{write}") from None
