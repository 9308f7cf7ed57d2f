"""Common forms of descriptors of different shapes, in which they are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from typing import TypeAlias

import numpy as np
import torch
from torch import Tensor

from ..hog import HOGSpec
from ..hog.box import Box
from ..hog.entries import CellAlignment, cell_entries
from ..hog.normalizers import Part
from ..hog.normalizers.four_block import four_block
from ..hog.orientation import bin_angles

DIRECTIONS = 18  # over 180°: the centres of 9 bins, whether the first is at 0° or at half a bin, are among them
_SLACK = 1e-9  # radians


@dataclass(frozen=True)
class Entries:
    """A descriptor in a common form.

    Attributes:
        values: (rows, cols, entries of a cell).
        top, left: row and column of its first cell in the image.
    """

    values: Tensor
    top: int
    left: int

    @property
    def region(self) -> Box:
        """Its cells."""
        rows, cols = self.values.shape[:2]
        return Box(self.left, self.top, self.left + cols, self.top + rows)

    def within(self, region: Box) -> Tensor:
        """The values of these cells, (entries,); the region lies within :attr:`region`."""
        inside = Box(region.x0 - self.left, region.y0 - self.top, region.x1 - self.left, region.y1 - self.top)
        return self.values[inside.rows, inside.cols].flatten()


@dataclass(frozen=True)
class Orientations:
    """The form that every HOG has: strength of the gradients of each cell by unsigned orientation.

    Opposite bins are added.  Of a four-block descriptor the undirected channels are used if it has them; of blocks, the
    mean over all blocks of a cell.  Entries are interpolated linearly between the centres of bins and resampled every
    10°, which leaves 9 bins unchanged whether the first is centred at 0° or at 10°.
    """

    def reduced(self, spec: HOGSpec) -> HOGSpec:
        """The spec of the part of the descriptor that is compared."""
        return replace(spec, normalizer=spec.normalizer.of_orientations())

    def entries(self, descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int]) -> Entries:
        """Brings a descriptor (1, rows, cols, channels) of a :meth:`reduced` spec into the common form."""
        of_cells = cell_entries(descriptor, spec)
        if spec.pooling.has_blocks:  # cells that lie on each other are one
            of_cells = CellAlignment(spec, image_size, of_cells)(of_cells)
        values = torch.einsum("db,brc->rcd", resampling_weights(spec).to(of_cells), of_cells[0])
        return Entries(values, *_first(spec))


@dataclass(frozen=True)
class Channels:
    """Channels with the same meaning in two four-block descriptors, unchanged.

    Attributes:
        parts: names of the channels.
    """

    parts: tuple[Part, ...]

    def reduced(self, spec: HOGSpec) -> HOGSpec:
        """As of :class:`Orientations`."""
        normalizer = four_block(spec.normalizer)
        assert normalizer is not None
        scheme = replace(normalizer, parts=self.parts)
        return replace(spec, normalizer=scheme if "texture" in self.parts else replace(scheme, texture="vlfeat"))

    def entries(self, descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int]) -> Entries:
        """As of :class:`Orientations`."""
        return Entries(descriptor[0], *_first(spec))


CommonForm: TypeAlias = Orientations | Channels
"""The forms that two descriptors can be brought into."""


def same_channels(a: HOGSpec, b: HOGSpec) -> Channels | None:
    """The channels with the same meaning in two descriptors: histograms of the same orientations, and texture."""
    one, other = four_block(a.normalizer), four_block(b.normalizer)
    if one is None or other is None or a.colours != b.colours:
        return None
    parts: list[Part] = []
    if a.signed and b.signed and _same_angles(a, b, 2 * math.pi):
        parts.append("directed")
    if _same_angles(a, b, math.pi):
        parts += ["undirected", "texture", "blocks"]
    common = tuple(part for part in parts if part in one.parts and part in other.parts)
    return Channels(common) if {*common} - {"texture"} else None


def _same_angles(a: HOGSpec, b: HOGSpec, period: float) -> bool:
    """Whether the undirected bins, or with a period of 360° all bins, have the same centres."""
    first, second = (bin_angles(s)[: s.bins // 2 if s.signed and period == math.pi else s.bins] for s in (a, b))
    if len(first) != len(second):
        return False
    difference = np.mod(first - second + _SLACK, period)
    return bool((difference < 2 * _SLACK).all())


def resampling_weights(spec: HOGSpec) -> Tensor:
    """Weights (directions, bins) that interpolate entries of bins linearly at k·10°, and add opposite directions."""
    return _resampling_weights(tuple(bin_angles(spec).tolist()), spec.signed)


@lru_cache(maxsize=64)
def _resampling_weights(centres: tuple[float, ...], signed: bool) -> Tensor:
    period = 2 * math.pi if signed else math.pi
    directions = torch.arange(DIRECTIONS, dtype=torch.float64) * (math.pi / DIRECTIONS)
    weights = torch.zeros(DIRECTIONS, len(centres), dtype=torch.float64)
    for turn in (0.0, math.pi) if signed else (0.0,):
        difference = (directions + turn).unsqueeze(1) - torch.tensor(centres, dtype=torch.float64)
        difference = difference - period * (difference / period).round()
        weights += (1 - difference.abs() * (len(centres) / period)).clamp(min=0)
    return weights


def _first(spec: HOGSpec) -> tuple[int, int]:
    """Row and column of the first cell."""
    return spec.normalizer.footprint(0).margin, spec.normalizer.footprint(1).margin


def region(spec: HOGSpec, image_size: tuple[int, int]) -> Box:
    """The cells of the descriptor of an image of (height, width).

    Raises:
        ValueError: the image is too small to have any.
    """
    (top, bottom), (left, right) = (
        _cells_along(spec, axis, count) for axis, count in enumerate(spec.grid(*image_size))
    )
    return Box(left, top, right, bottom)


def _cells_along(spec: HOGSpec, axis: int, count: int) -> tuple[int, int]:
    """The first of the cells side by side in so many rows or columns of a descriptor, and the one after the last."""
    along = spec.normalizer.footprint(axis)
    places = spec.pooling.places(along.cells(count), spec.cell_size[axis], axis)
    return along.margin, max(places) + 1 - along.margin


def common_region(regions: list[Box]) -> Box | None:
    """The intersection, or None if it is empty."""
    common = reduce(Box.intersect, regions)
    return common if common.width > 0 and common.height > 0 else None


def unit(values: Tensor) -> Tensor:
    """Scales to length 1, in float64; 0 stays 0."""
    values = values.double()
    length = float(values.norm())
    return values / length if length else values
