"""The ways in which pixels vote into cells, each with its constants: Eq. 5-6 and what libraries do instead."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias

from .checks import LONGEST_SIDE, check_fields, shortened
from .normalizers import Footprint, Normalizer

if TYPE_CHECKING:
    from torch import Tensor

PartialCells: TypeAlias = Literal["floor", "round", "ceil"]
Beyond: TypeAlias = Literal["vote", "drop", "repeat"]


class Spacing(NamedTuple):
    """Where cells are along one axis: ``cells`` of them side by side, and so on every ``step`` pixels."""

    step: int
    cells: int


@dataclass(frozen=True)
class Pooling(ABC):
    """From votes of pixels to histograms of cells, by weights along either axis: the third of the four steps.

    A new pooling is a frozen dataclass of its constants in this file, an entry of ``POOLINGS``, and tests.
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
        """The number of cells along an axis of ``pixels`` pixels."""
        if partial == "floor":
            return pixels // cell
        return (pixels + cell // 2) // cell if partial == "round" else -(-pixels // cell)

    def smallest(self, cell_size: tuple[int, int]) -> tuple[str, tuple[int, int]]:
        """A word for what the smallest image must hold, and its (height, width)."""
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
        """The first pixel of a cell along an axis."""
        step, cells = self.spacing(cell, axis)
        return index // cells * step + index % cells * cell

    def places(self, cells: int, cell: int, axis: int) -> list[int]:
        """Which of the cells side by side in the image each cell along an axis is; the nearest if between two."""
        step, of_block = self.spacing(cell, axis)
        return [round(k // of_block * step / cell) + k % of_block for k in range(cells)]


@dataclass(frozen=True)
class BilinearCells(Pooling):
    """Each pixel votes into the two nearest cells along either axis, by 1 - distance / cell (Eq. 5-6).

    Attributes:
        beyond: pixels on the far side of the last cell, and those that it lacks if the image ends before it does.
            ``"vote"``: the former vote with the weight that is left, the latter do not exist (VLFeat); ``"drop"``: the
            former do not vote (dlib, Piotr Dollár); ``"repeat"``: nor do they, and for the latter the last pixel that
            votes votes again (DPM).
        edge_gain: what the histograms of the first and the last row and column of cells are multiplied with, which
            miss some votes.
    """

    beyond: Beyond = "vote"
    edge_gain: float = 1.0
    kind: ClassVar[str] = "bilinear"
    interpolates: ClassVar[bool] = True
    """Two neighbouring triangles sum to 1."""

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """Row k is the bilinear filter of Eq. 5 along one axis, placed at the centre of cell k (Eq. 6).

        Two neighbouring cells share each pixel between their centres.
        """
        # pixels 0 … last - 1 of the cells, or of the image, vote; without the first and the last if there is a ring
        last = {"vote": pixels, "drop": min(cells * cell, pixels), "repeat": cells * cell}[self.beyond]
        matrix = triangles(max(last, pixels), cell, cells, like)
        matrix[:, last:] = 0
        if ring:
            matrix[:, 0] = matrix[:, last - 1] = 0
        if last > pixels:  # DPM: what the image lacks is its last pixel that votes, again
            of_last = max(pixels - 1 - ring, 0)
            matrix[:, of_last] += matrix[:, of_last + 1 :].sum(dim=1)
            matrix = matrix[:, :pixels].contiguous()
            matrix[:, of_last + 1 :] = 0
        for outermost in {0, cells - 1}:
            matrix[outermost] *= self.edge_gain
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return cell, 2 * cell


def triangles(pixels: int, cell: int, cells: int, like: Tensor) -> Tensor:
    """f^s of Eq. 5 along one axis, (cells, pixels): 1 - distance to each cell's centre in cells, at least 0.

    Distances are whole numbers of half pixels: a weight is rounded once, and alike wherever the cell is.
    """
    import torch

    ahead = 2 * torch.arange(pixels, device=like.device) + 1 - cell  # of the centre of cell 0
    before = torch.div(ahead, 2 * cell, rounding_mode="floor")  # the cell whose centre is at the pixel's or before it
    of_next = (ahead - 2 * cell * before).to(like.dtype) / (2 * cell)
    of_this = (2 * cell * (before + 1) - ahead).to(like.dtype) / (2 * cell)
    # a row before the first cell and one after the last for the votes that leave the image
    matrix = torch.zeros(cells + 2, pixels, dtype=like.dtype, device=like.device)
    matrix.scatter_(0, (before + 1).clamp(max=cells + 1).unsqueeze(0), of_this.unsqueeze(0))
    matrix.scatter_(0, (before + 2).clamp(max=cells + 1).unsqueeze(0), of_next.unsqueeze(0))
    return matrix[1:-1]


@dataclass(frozen=True)
class BoxCells(Pooling):
    """Each pixel votes into its own cell.

    Attributes:
        mean: whether a histogram is the mean over its pixels, not their sum.
        window: pixels of the side of a Gaussian window, of sum 1, that is tiled over the image and weighs its votes;
            its standard deviation is half of that.  0 for none.
    """

    mean: bool = False
    window: int = 0
    kind: ClassVar[str] = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        if type(self.window) is not int or self.window == 1 or not 0 <= self.window <= LONGEST_SIDE:
            raise ValueError(
                f"window must be 0 or a number of pixels in 2 … {LONGEST_SIDE:,}, got {shortened(self.window)}"
            )

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """1 in a pixel's own cell, or what the window and the mean make of it."""
        import torch

        pixel = torch.arange(pixels, device=like.device)
        weights = torch.ones(pixels, dtype=like.dtype, device=like.device)
        if self.mean:
            weights = weights / cell
        if self.window:
            side = torch.arange(self.window, dtype=like.dtype, device=like.device)
            window = torch.exp(-0.5 * ((side - side.mean()) / (self.window // 2)) ** 2)
            weights = weights * (window / window.sum())[pixel % self.window]
        # a row after the last cell for the pixels that are in none
        matrix = torch.zeros(cells + 1, pixels, dtype=like.dtype, device=like.device)
        own = torch.div(pixel, cell, rounding_mode="floor").clamp(max=cells)
        matrix = matrix.scatter_(0, own.unsqueeze(0), weights.unsqueeze(0))[:-1]
        if ring:
            matrix[:, 0] = matrix[:, -1] = 0
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return 0, cell

    @property
    def tile(self) -> int:
        return self.window or 1


@dataclass(frozen=True)
class BlockCells(Pooling):
    """Blocks of cells at a step in pixels, each with histograms of its own: votes do not leave their block (OpenCV).

    Attributes:
        block: (height, width) of a block in pixels, whole cells.
        step: (height, width) in pixels from one block to the next.
        sigma: standard deviation in pixels of the Gaussian that weighs a block's votes; its middle is the pixel
            of index side / 2.
    """

    block: tuple[int, int]
    step: tuple[int, int]
    sigma: float
    kind: ClassVar[str] = "block"
    has_blocks: ClassVar[bool] = True

    def check(self, cell_size: tuple[int, int], normalizer: Normalizer) -> None:
        """Blocks must be whole cells, and be those of the normaliser."""
        if any(b % c for b, c in zip(self.block, cell_size, strict=True)):
            raise ValueError(f"blocks of {self.block} pixels must be whole cells of {cell_size} pixels")
        cells = self.block[0] // cell_size[0], self.block[1] // cell_size[1]
        blocks = [Footprint(step=n, extent=n) for n in cells]
        if [normalizer.footprint(axis) for axis in (0, 1)] != blocks or normalizer.reach() != 0:
            raise ValueError(f"BlockCells go with a BlockNorm whose block and step are both {cells} cells")

    def spacing(self, cell: int, axis: int) -> Spacing:
        return Spacing(self.step[axis], self.block[axis] // cell)

    def cells(self, pixels: int, cell: int, axis: int, partial: PartialCells) -> int:
        blocks = (pixels - self.block[axis]) // self.step[axis] + 1
        return blocks * (self.block[axis] // cell)

    def smallest(self, cell_size: tuple[int, int]) -> tuple[str, tuple[int, int]]:
        return "block", self.block

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """Weights of the cells of each block in turn, by rows."""
        import torch

        block, step = self.block[axis], self.step[axis]
        inside = torch.arange(block, dtype=like.dtype, device=like.device)
        weights = triangles(block, cell, block // cell, like)
        weights = weights * torch.exp(-((inside - block / 2) ** 2) / (2 * self.sigma**2))
        matrix = like.new_zeros((pixels - block) // step + 1, block // cell, pixels)
        for k, of_block in enumerate(matrix):
            of_block[:, k * step : k * step + block] = weights
        matrix = matrix.flatten(0, 1)
        if ring:
            matrix[:, 0] = matrix[:, -1] = 0
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return 0, self.block[axis]


POOLINGS: dict[str, type[Pooling]] = {each.kind: each for each in (BilinearCells, BoxCells, BlockCells)}
