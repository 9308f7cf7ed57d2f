"""The interface of normalisers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from ..parts import Part

if TYPE_CHECKING:
    from torch import Tensor


SAME = 1e-4  # relative difference of entries that may be one number, the clip
ROUNDED_ROW = 8  # the tolerance of sums, divided by it, is how far rounding moves a histogram


class Footprint(NamedTuple):
    """The cells of a descriptor along one axis: entry k has cells margin + k·step … margin + k·step + extent - 1.

    Attributes:
        step: cells from one entry to the next.
        extent: cells of an entry.
        margin: cells at either end that are in no entry.
    """

    step: int = 1
    extent: int = 1
    margin: int = 0

    def count(self, cells: int) -> int:
        """The number of entries along ``cells`` cells; below 1 if there is none."""
        return (cells - 2 * self.margin - self.extent) // self.step + 1

    def cells(self, count: int) -> int:
        """The least number of cells that makes a given number of entries."""
        return (count - 1) * self.step + self.extent + 2 * self.margin

    def covers(self, cells: int) -> list[bool]:
        """For each of a number of cells, whether it is in an entry."""
        end = self.margin + self.count(cells) * self.step - self.step + self.extent
        return [self.margin <= cell < end and (cell - self.margin) % self.step < self.extent for cell in range(cells)]


class Identity(NamedTuple):
    """What holds of the numbers that a normaliser makes.

    Attributes:
        sentence: says so, for readers.
        errors: of each equation, or how far a bound is exceeded; 0 but for rounding.
        share: of the equations, the least that holds.  0 where all may fail, but hardly one holds of other numbers.
        is_bound: whether numbers of other normalisers may satisfy it as well.
        has_scale: whether neither larger nor smaller multiples of the numbers satisfy it.
    """

    sentence: str
    errors: Tensor
    share: float = 1.0
    is_bound: bool = False
    has_scale: bool = True


@dataclass(frozen=True)
class Normalizer(Part):
    """From cell histograms to the descriptor: the last of the four steps.

    A new normaliser is a frozen dataclass of its constants in a file of this folder.  It must have:

    * ``kind``, its name in JSON;
    * :meth:`channels`, :meth:`footprint` and :meth:`reach`: the shape of the descriptor, and which cells matter.
      Grids, sizes of images, coordinates and strips follow from them;
    * :meth:`normalize`, of which PyTorch finds all derivatives;
    * :meth:`channel_names`, for readers;
    * :meth:`cell_entries` and :attr:`fixes_contrast`, for inversion.

    Of one that makes a vector as long as its histogram of each cell, :class:`PerCell` has most of these.

    It may have: :meth:`check`, if it does not go with all bins; :meth:`image_factor`, if one number normalises all of
    an image; :meth:`invert`, if histograms can be computed back in closed form; :meth:`identities` and
    :meth:`scale`, by which its descriptors are recognised; :meth:`native_constants`, for a header in ``native``.
    Unless ``native/operator.h`` lists its ``kind``, native cells are followed by :meth:`normalize`.
    The rest has defaults that hold unless channels are left out, or have a meaning beside the bins of cells.  Fields
    are converted by their types, see :func:`.convert_fields`.
    """

    kinds: ClassVar[dict[str, type[Normalizer]]] = {}
    """The classes of all normalisers by their ``kind``."""

    def check(self, bins: int, signed: bool) -> None:
        """Raises ValueError unless it fits this number of orientation bins, signed or not."""

    @abstractmethod
    def channels(self, bins: int, signed: bool) -> int:
        """Descriptor channels of one colour."""

    @abstractmethod
    def footprint(self, axis: int) -> Footprint:
        """The cells of each row (axis 0), or column (axis 1), of the descriptor."""

    @abstractmethod
    def reach(self) -> int | None:
        """How many cells beyond its own an entry depends on, to either side; None if on the whole image."""

    @abstractmethod
    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """Histograms (B, bins, rows, cols) to (B, channels, descriptor rows, columns): operations of PyTorch."""

    @abstractmethod
    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
        """Names of the channels of one colour, for readers.

        Args:
            bins: what each bin is.
            axes: what each undirected orientation is; bins that are not signed are these.
        """

    @abstractmethod
    def cell_entries(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """Entries that belong to each cell's histogram: (B, channels, rows, cols) to (B, bins, rows, cols) of cells.

        Cells that are in no entry are not there.
        """

    @property
    @abstractmethod
    def fixes_contrast(self) -> bool:
        """Whether entries of strong edges grow with the contrast, so that an inversion can take it from them.

        Those of faint edges always grow with it, beside ε; this is too little for an inversion even where ε is large.
        """

    def image_factor(self, energy: float) -> float:
        """The one factor of all histograms of an image, from the sum of their squares.

        Called only if entries depend on the whole image.
        """
        raise NotImplementedError(
            f"the {self.kind} normaliser needs the whole image: without {type(self).__name__}.image_factor its "
            f"descriptors cannot be streamed"
        )

    def invert(self, channels: Tensor) -> Tensor | None:
        """Histograms (B, bins, rows, cols) of descriptors (B, channels, rows, cols) in closed form, if there is one."""
        return None

    def scale(self, channels: Tensor) -> float | None:
        """By what descriptors (B, channels, rows, cols) were multiplied, if it can be told."""
        return None

    def identities(self, channels: Tensor, bins: int, signed: bool, tolerance: float) -> Iterator[Identity]:
        """What descriptors (B, channels, rows, cols), float64, of this normaliser satisfy up to rounding.

        ``tolerance`` is the rounding of sums of entries.
        """
        yield from ()

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """The numbers that its native loops read, in the order of its header in ``native``."""
        return ()

    @property
    def layout_block(self) -> tuple[int, int] | None:
        """(rows, cols) of the cells whose bins are the channels, in blocks; None if channels are something else."""
        return None

    @property
    def keeps_directions(self) -> bool:
        """Whether :meth:`cell_entries` tell signed gradients from their opposites."""
        return True

    @property
    def needs_directed(self) -> bool:
        """Whether some channel is made from more than the sums of opposite bins."""
        return True

    def bin_weights(self, weights: Tensor, bins: int, signed: bool) -> Tensor:
        """The mean weight (B, bins, rows, cols) that a linear detector (B, channels, rows, cols) gives each bin."""
        return self.cell_entries(weights, bins, signed)

    def edge_strengths(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """The part that says how strong edges are: (B, channels, rows, cols) to (B, n, rows, cols) of the first n bins.

        Cells that are in no entry are not there.
        """
        return self.cell_entries(channels, bins, signed)


def root(values: Tensor) -> Tensor:
    """√ of each value, with derivative 0 at 0."""
    zero = values == 0
    return values.masked_fill(zero, 1.0).sqrt().masked_fill(zero, 0.0)


def clipped(values: Tensor, clip: float) -> Tensor:
    """Clips at ``clip``, with the mean of the one-sided derivatives there, unlike ``clamp``."""
    return values.minimum(values.new_full((), clip))  # a number that is made on the device


def proportion_errors(
    first: Tensor, second: Tensor, first_clip: Tensor | float, second_clip: Tensor | float, *, tolerance: float
) -> Tensor:
    """How far rows (…, n) are from multiples of each other, relative to their length, where neither is clipped.

    Rows with fewer than three such entries that are not 0 are left out.  ``tolerance`` is that of sums: a part of it
    is how far rounding moves a row, whatever its length.
    """
    free = (first < first_clip * (1 - SAME)) & (second < second_clip * (1 - SAME))
    first, second = first.where(free, first.new_zeros(())), second.where(free, second.new_zeros(()))
    tell = ((first > 0) & (second > 0)).sum(dim=-1) > 2
    first, second = first[tell], second[tell]
    factors = (first * second).sum(dim=-1, keepdim=True) / second.square().sum(dim=-1, keepdim=True)
    residuals = (first - factors * second).norm(dim=-1) - tolerance / ROUNDED_ROW * (1 + factors.squeeze(-1))
    errors: Tensor = residuals.clamp(min=0) / first.norm(dim=-1)
    return errors
