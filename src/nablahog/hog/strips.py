"""Which rows of an image some rows of its descriptor hang on: a crop that has them, too, bit by bit.

A crop's histograms are others than the image's in three ways.  Votes from beyond it are missing, and gradients of its
first and its last row are others: it is larger than what is wanted of it.  A Gaussian window that is tiled over the
image begins anew: the crop begins where a tile does.  And how the compiled loops round hangs on where they end one band
of rows and begin the next, which they find from the top: the crop begins where the image's bands go on as they do at
its top, and what is wanted begins where they have settled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import torch

from .kernels import parameters, supports
from .poolings import Spacing
from .spec import HOGSpec

_STEPS = 96  # of an image that is tall enough to see how its bands repeat


class Span(NamedTuple):
    """Rows ``start`` … ``stop`` - 1."""

    start: int
    stop: int


@dataclass(frozen=True)
class Strip:
    """Rows of a descriptor, and what they are made from.

    Attributes:
        rows: of the descriptor.
        pixels: of the image, the crop.
        cells: of the crop's cells, those that the normaliser makes the rows from.
        before: how many rows it makes of these that are before the first one.
    """

    rows: Span
    pixels: Span
    cells: Span
    before: int


class _Bands(NamedTuple):
    """How bands follow each other, in rows of pixels."""

    period: int  # after which they repeat
    settled: int  # from the top, from where on they do
    longest: int  # of one


class Strips:
    """The strips of an image, each of which can be computed by itself.

    Args:
        spec: the dialect.
        height, width: of the image.
        dtype: of its histograms, float32 or float64.

    Attributes:
        total: rows of the whole descriptor.
        apart: rows of pixels from one row of the descriptor to the next.
        margin: rows of pixels that a strip may need beside those.

    Raises:
        ValueError: the image is too small to have a descriptor.
    """

    def __init__(self, spec: HOGSpec, height: int, width: int, dtype: torch.dtype) -> None:
        self.total = spec.grid(height, width)[0]
        self._spec, self._height, self._cells = spec, height, spec.cells(height, width)[0]
        self._footprint = spec.normalizer.footprint(0)
        self._reach = spec.normalizer.reach() or 0  # or what needs the whole image is computed before
        self._step, self._at_once = _spacing(spec, 0)
        self._before: int
        self._after: int
        self._before, self._after = _reach(spec, 0)
        # wide enough for some pixel to vote into as many columns as one ever does
        self._bands: _Bands = _bands(spec, min(width, 2 * _reach(spec, 1)[1] + _spacing(spec, 1).step), dtype)
        self._unit = math.lcm(self._bands.period, spec.pooling.tile)
        self.apart = self._footprint.step // self._at_once * self._step
        cells = self._footprint.extent + 2 * max(self._reach, 1)
        most = cells * self._step + self._before + self._after + self._unit
        self.margin = most + self._bands.settled + self._below

    @property
    def _below(self) -> int:
        """Rows of pixels after the last one that votes: the last band is as in the image, and so is the gradient."""
        return self._bands.longest + self._after + 1

    def of(self, rows: int) -> Iterator[Strip]:
        """All strips from the top, of ``rows`` of the descriptor, at least 1; but of as many that most are alike."""
        even = self._unit // math.gcd(self._unit, self.apart)
        rows = max(rows // even * even, min(rows, even))
        return (self._strip(Span(first, min(first + rows, self.total))) for first in range(0, self.total, rows))

    def _strip(self, rows: Span) -> Strip:
        cells, before = self._needed(rows)
        steps = Span(cells.start // self._at_once, -(-cells.stop // self._at_once))
        start = self._aligned(steps.start * self._step - self._before - self._bands.settled)
        stop = (steps.stop - 1) * self._step + self._after + self._below
        stop = min(-(-stop // self._step) * self._step, self._height)
        first = start // self._step * self._at_once
        return Strip(rows, Span(start, stop), Span(cells.start - first, cells.stop - first), before)

    def _aligned(self, row: int) -> int:
        return max(row, 0) // self._unit * self._unit

    def _needed(self, rows: Span) -> tuple[Span, int]:
        """The rows of cells that rows of the descriptor are made from, and how many before them it makes of these."""
        step, extent, margin = self._footprint
        around = -(-max(self._reach - margin, 0) // step)  # entries before the first one that begin with its reach
        before = min(around, rows.start)
        stop = (rows.stop - 1) * step + margin + extent + max(self._reach, margin)
        return Span((rows.start - before) * step, min(stop, self._cells)), before


def _spacing(spec: HOGSpec, axis: int) -> Spacing:
    """Pixels after which weights repeat, but for a window's, and the cells in these."""
    return spec.pooling.spacing(spec.cell_size[axis], axis)


def _reach(spec: HOGSpec, axis: int) -> tuple[int, int]:
    """From how many pixels before a cell's first, or a block's, to how many after it votes come."""
    return spec.pooling.reach(spec.cell_size[axis], axis)


@lru_cache(maxsize=64)
def _bands(spec: HOGSpec, width: int, dtype: torch.dtype) -> _Bands:
    """Of tall images, at least so wide."""
    step, reach = _spacing(spec, 0).step, _reach(spec, 0)[1]
    if not supports(spec):
        return _Bands(step, 1, 1)  # plain steps have no bands
    height = _STEPS * step + 16 * reach
    bands = [(int(start), int(stop)) for start, stop, _ in parameters.pooling(spec, height, width, dtype).bands]
    longest = max(stop - start for start, stop in bands)
    seen = {band for band in bands if band[1] <= height - reach}  # not those at the bottom, whose cells are missing
    end = max(stop for _, stop in seen)
    first = [stop for start, stop in seen if start == 0]  # has the first row, whose gradient is another in a crop
    for period in range(step, end // 2, step):
        odd = [stop for start, stop in seen if stop + period <= end and (start + period, stop + period) not in seen]
        settled = max(odd + first, default=1)
        if settled + period <= end // 2:
            return _Bands(period, settled, longest)
    raise AssertionError(f"bands of {spec.named} descriptor do not repeat")
