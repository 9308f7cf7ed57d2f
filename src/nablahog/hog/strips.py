"""The crop of an image that reproduces given rows of its descriptor bit for bit.

The histograms of a crop differ from those of the image for three reasons:

* Votes of pixels outside the crop are missing, and gradients at its border differ.  So a crop has rows to spare.
* A Gaussian window that is tiled over the image starts again.  So a crop starts where a tile does.
* The native loops round differently where one band of rows ends and the next begins.  Bands are counted from the top
  and repeat after a few of them.  So a crop starts at a whole period, and its first bands are to spare, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import torch

from .kernels.loops import supports
from .kernels.tables import pooling_stretches
from .spec import HOGSpec

_SPACINGS = 96  # of an image that is tall enough to see how its bands repeat


class Span(NamedTuple):
    """Rows ``start`` … ``stop`` - 1."""

    start: int
    stop: int


class Strip(NamedTuple):
    """Rows of a descriptor, and what they are computed from."""

    rows: Span  # of the descriptor
    pixels: Span  # the crop, rows of the image
    cells: Span  # the rows of the crop's cells that are normalised
    before: int  # how many rows of their descriptor precede the first of ``rows``


class _Bands(NamedTuple):
    """The bands of a tall image, in rows of pixels."""

    period: int  # bands repeat after so many rows
    settled: int  # from this row on
    longest: int  # rows of the longest band


class Strips:
    """The strips of an image, each of which can be computed by itself.

    Args:
        spec: the dialect.
        height, width: of the image.
        dtype: of its histograms, float32 or float64.

    Attributes:
        total: rows of the whole descriptor.
        row_distance: rows of pixels from one row of the descriptor to the next.
        margin: rows of pixels that a strip may need in addition.

    Raises:
        ValueError: the image is too small to have a descriptor.
    """

    def __init__(self, spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> None:
        self.total = spec.grid(height, width)[0]
        self._height, self._cells = height, spec.cells(height, width)[0]
        self._footprint = spec.normalizer.footprint(0)
        self._reach = spec.normalizer.reach() or 0  # or what needs the whole image is computed before
        pooling, (down, across) = spec.pooling, spec.cell_size
        self._step, self._at_once = pooling.spacing(down, 0)
        self._before, self._after = pooling.reach(down, 0)
        # wide enough for some pixel to vote into as many columns as one ever does
        wide = 2 * pooling.reach(across, 1)[1] + pooling.spacing(across, 1).step
        self._bands: _Bands = _bands(spec, min(width, wide), dtype)
        self._below = self._bands.longest + self._after + 1  # the last row that votes: a band, a row for its gradient
        self._unit = math.lcm(self._bands.period, pooling.tile)
        self.row_distance = self._footprint.step // self._at_once * self._step
        cells = self._footprint.extent + 2 * max(self._reach, 1)
        most = cells * self._step + self._before + self._after + self._unit
        self.margin = most + self._bands.settled + self._below

    def split(self, rows: int) -> Iterator[Strip]:
        """All strips from the top, of about ``rows`` rows, at least 1; rounded so that most crops are of one size."""
        even = self._unit // math.gcd(self._unit, self.row_distance)
        rows = max(rows // even * even, min(rows, even))
        return (self._strip(Span(first, min(first + rows, self.total))) for first in range(0, self.total, rows))

    def _strip(self, rows: Span) -> Strip:
        cells, before = self._needed(rows)
        spacings = Span(cells.start // self._at_once, -(-cells.stop // self._at_once))
        start = max(spacings.start * self._step - self._before - self._bands.settled, 0) // self._unit * self._unit
        stop = (spacings.stop - 1) * self._step + self._after + self._below
        stop = min(-(-stop // self._step) * self._step, self._height)
        first = start // self._step * self._at_once
        return Strip(rows, Span(start, stop), Span(cells.start - first, cells.stop - first), before)

    def _needed(self, rows: Span) -> tuple[Span, int]:
        """The rows of cells that rows of the descriptor depend on, and how many of its rows precede these there."""
        step, extent, margin = self._footprint
        around = -(-max(self._reach - margin, 0) // step)  # rows whose first cell is within reach of the first one
        before = min(around, rows.start)
        stop = (rows.stop - 1) * step + margin + extent + max(self._reach, margin)
        return Span((rows.start - before) * step, min(stop, self._cells)), before


@lru_cache(maxsize=64)
def _bands(spec: HOGSpec, width: int, dtype: torch.dtype) -> _Bands:
    """The bands of tall images that are at least so wide."""
    cell = spec.cell_size[0]
    step, reach = spec.pooling.spacing(cell, 0).step, spec.pooling.reach(cell, 0)[1]
    if not supports(spec):
        return _Bands(step, 1, 1)  # plain steps have no bands
    height = _SPACINGS * step + 16 * reach
    rows = pooling_stretches(spec, height, width, dtype)[0]
    bands = [(int(start), int(stop)) for start, stop, _ in rows.limits]
    longest = max(stop - start for start, stop in bands)
    inner = {band for band in bands if band[1] <= height - reach}  # not those at the bottom, whose cells are missing
    end = max(stop for _, stop in inner)
    first = [stop for start, stop in inner if start == 0]  # has the first row, whose gradient differs in a crop
    for period in range(step, end // 2, step):
        odd = [stop for start, stop in inner if stop + period <= end and (start + period, stop + period) not in inner]
        settled = max(odd + first, default=1)
        if settled + period <= end // 2:
            return _Bands(period, settled, longest)
    raise AssertionError(f"bands of {spec.named} descriptor do not repeat")
