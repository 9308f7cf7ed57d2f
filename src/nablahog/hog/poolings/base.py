"""The interface of poolings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias

from ..checks import check_fields

if TYPE_CHECKING:
    from torch import Tensor

    from ..normalizers import Normalizer

PartialCells: TypeAlias = Literal["floor", "round", "ceil"]


class Spacing(NamedTuple):
    """Where cells are along one axis: ``cells`` of them side by side, and so on every ``step`` pixels."""

    step: int
    cells: int


@dataclass(frozen=True)
class Pooling(ABC):
    """From votes of pixels to histograms of cells, by weights along either axis: the third of the four steps.

    A new pooling is a frozen dataclass of its constants in a file of this folder, a line in ``POOLINGS``, and tests.
    It must have:

    * ``kind``, its name in JSON;
    * :meth:`weights`, from which both the reference steps and the compiled loops pool.  A pixel's cells follow each
      other;
    * :meth:`reach`, which pixels matter for a cell.

    Unless cells are side by side it must have :meth:`spacing` and :meth:`cells`, too.  Fields are checked by their
    types, see :func:`.checks.check_fields`.
    """

    kind: ClassVar[str]
    interpolates: ClassVar[bool] = False
    """Whether the weights of a pixel sum to 1, so that they interpolate between the middles of cells."""
    has_blocks: ClassVar[bool] = False
    """Whether cells of several blocks may lie on each other, each with weights of its own."""

    def __post_init__(self) -> None:
        check_fields(self)

    def check(self, cell_size: tuple[int, int], normalizer: Normalizer) -> None:  # noqa: B027
        """Raises ValueError unless it goes with cells of this size and the normaliser."""

    def spacing(self, cell: int, axis: int) -> Spacing:
        """Where cells of ``cell`` pixels are along an axis, 0 for rows: side by side."""
        return Spacing(cell, 1)

    def cells(self, pixels: int, cell: int, axis: int, partial: PartialCells) -> int:
        """How many cells there are along an axis of so many pixels."""
        if partial == "floor":
            return pixels // cell
        return (pixels + cell // 2) // cell if partial == "round" else -(-pixels // cell)

    def smallest(self, cell_size: tuple[int, int]) -> tuple[str, tuple[int, int]]:
        """What the smallest image must hold, in a word, and its (height, width)."""
        return "cell", cell_size

    @abstractmethod
    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """Weights (cells, pixels) of pixels along an axis in cells of ``cell`` pixels.

        Args:
            pixels, cells: along the axis.
            cell: pixels of a cell.
            axis: 0 for rows.
            ring: whether the outermost pixels cast no votes.
            like: a tensor whose dtype and device to use.
        """

    @abstractmethod
    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        """How many pixels before, and after, the first pixel of a :class:`Spacing` vote into its cells."""

    @property
    def tile(self) -> int:
        """Pixels after which weights repeat, beside :class:`Spacing`."""
        return 1

    def first_pixel(self, index: int, cell: int, axis: int) -> int:
        """Of a cell along an axis."""
        step, cells = self.spacing(cell, axis)
        return index // cells * step + index % cells * cell

    def places(self, cells: int, cell: int, axis: int) -> list[int]:
        """Which of the cells side by side in the image each cell along an axis is; the nearest if between two."""
        step, of_block = self.spacing(cell, axis)
        return [round(k // of_block * step / cell) + k % of_block for k in range(cells)]
