"""The ways in which pixels vote into cells, each with its constants: Eq. 5-6 and what libraries do instead."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias

from ..inputs.numbers import LONGEST_SIDE, shortened
from .normalizers import Footprint, Normalizer
from .parts import Part

if TYPE_CHECKING:
    from torch import Tensor

PartialCells: TypeAlias = Literal["floor", "round", "ceil"]
Beyond: TypeAlias = Literal["vote", "drop", "repeat"]


class Taps(NamedTuple):
    """The neighbouring cells that each pixel along an axis votes into.

    Attributes:
        first: (pixels,) int64, the first of them.
        weights: (pixels, n), of the pixel's votes in the n cells from there on.
    """

    first: Tensor
    weights: Tensor


class Spacing(NamedTuple):
    """Where cells are along one axis: ``cells`` of them side by side, and so on every ``step`` pixels."""

    step: int
    cells: int


@dataclass(frozen=True)
class Pooling(Part):
    """From votes of pixels to histograms of cells, by weights along either axis: the third of the four steps.

    A new pooling is a frozen dataclass of its constants in this file.  It must have:

    * ``kind``, its name in JSON;
    * :meth:`taps`, from which both the reference steps and the compiled loops pool;
    * :meth:`reach`, which pixels matter for a cell.

    Unless cells are side by side it must have :meth:`spacing` and :meth:`cells`, too.  Fields are converted by
    their types, see :func:`.convert_fields`.
    """

    kinds: ClassVar[dict[str, type[Pooling]]] = {}
    """The classes of all poolings by their ``kind``."""
    interpolates: ClassVar[bool] = False
    """Whether the weights of a pixel sum to 1, so that they interpolate between the middles of cells."""
    has_blocks: ClassVar[bool] = False
    """Whether cells of several blocks may lie on each other, each with weights of its own."""

    def check(self, cell_size: tuple[int, int], normalizer: Normalizer) -> None:
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
    def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
        """The cells of ``cell`` pixels that pixels along an axis vote into.  Those that do not exist are ignored.

        Args:
            pixels, cells: along the axis.
            cell: pixels of a cell.
            axis: 0 for rows.
            ring: whether the outermost pixels cast no votes.
            like: a tensor whose device and, for weights, dtype to use.
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
        step, block_cells = self.spacing(cell, axis)
        return [round(k // block_cells * step / cell) + k % block_cells for k in range(cells)]


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

    def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
        """The bilinear filter of Eq. 5 along one axis, placed at the centre of each cell (Eq. 6).

        Two neighbouring cells share each pixel between their centres.
        """
        import torch

        # pixels 0 … last - 1 of the cells, or of the image, vote; without the first and the last if there is a ring
        last = {"vote": pixels, "drop": min(cells * cell, pixels), "repeat": cells * cell}[self.beyond]
        first, weights = triangles(max(last, pixels), cell, like)
        weights[last - int(ring) :] = 0  # not ring itself: torch.jit.trace makes the sides tensors
        if ring:
            weights[:1] = 0
        if last > pixels:
            first, weights = _repeated(first, weights, pixels, max(pixels - 1 - int(ring), 0), last, cell)
        if self.edge_gain != 1:
            own = first.unsqueeze(1) + torch.arange(weights.shape[1], device=like.device)
            weights = torch.where((own == 0) | (own == cells - 1), weights * self.edge_gain, weights)
        return Taps(first, weights)

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return cell, 2 * cell


def triangles(pixels: int, cell: int, like: Tensor) -> Taps:
    """f^s of Eq. 5 along one axis: 1 - distance to the centres of the two nearest cells, in cells.

    Distances are whole numbers of half pixels: a weight is rounded once, and alike wherever the cell is.
    """
    import torch

    ahead = 2 * torch.arange(pixels, device=like.device) + 1 - cell  # of the centre of cell 0
    before = torch.div(ahead, 2 * cell, rounding_mode="floor")  # the cell whose centre is at the pixel's or before it
    part = ahead - 2 * cell * before
    return Taps(before, torch.stack([2 * cell - part, part], dim=1).to(like.dtype) / (2 * cell))


def _repeated(first: Tensor, weights: Tensor, pixels: int, last_pixel: int, last: int, cell: int) -> Taps:
    """Gives ``last_pixel`` the votes of those behind it, up to ``last``, which the image lacks (DPM)."""
    from torch.nn.functional import pad

    behind = first[last_pixel + 1 :] - first[last_pixel]
    count = (2 * last - 1 - cell) // (2 * cell) - (2 * last_pixel + 1 - cell) // (2 * cell) + 2  # cells they vote into
    again = weights.new_zeros(count, len(behind))
    for k in (0, 1):
        again.scatter_(0, (behind + k).unsqueeze(0), weights[last_pixel + 1 :, k].unsqueeze(0))
    weights = pad(weights[:pixels], (0, count - 2))
    weights[last_pixel] += again.sum(dim=1)
    weights[last_pixel + 1 :] = 0
    return Taps(first[:pixels], weights)


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

    def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
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
        if ring:
            weights[:1] = weights[-1:] = 0
        return Taps(torch.div(pixel, cell, rounding_mode="floor"), weights.unsqueeze(1))

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

    def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
        """The cells of all blocks that a pixel is in, block by block."""
        import torch

        block, step, block_cells = self.block[axis], self.step[axis], self.block[axis] // cell
        inside = torch.arange(block, device=like.device)
        own = torch.arange(block_cells, device=like.device)
        first, shares = triangles(block, cell, like)
        before, after = (torch.where(first.unsqueeze(1) + k == own, shares[:, k : k + 1], 0) for k in (0, 1))
        gauss = torch.exp(-((inside.to(like.dtype) - block / 2) ** 2) / (2 * self.sigma**2))
        weights = torch.nn.functional.pad((before + after) * gauss.unsqueeze(1), (0, 0, 0, 1))  # of a pixel in no block
        pixel = torch.arange(pixels, device=like.device)
        first_block = torch.div(pixel - block, step, rounding_mode="floor").clamp(min=-1) + 1
        blocks = first_block.unsqueeze(1) + torch.arange(-(-block // step), device=like.device)
        place = pixel.unsqueeze(1) - step * blocks
        weights = weights[torch.where((place >= 0) & (place < block), place, block)].flatten(1)
        if ring:
            weights[:1] = weights[-1:] = 0
        return Taps(first_block * block_cells, weights)

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return 0, self.block[axis]
