"""The normalisers of all dialects, each with its constants: what becomes of cell histograms."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias, get_args

from .checks import check_choice, check_pair, check_positive

GlobalForm: TypeAlias = Literal["printed", "robust"]
Part: TypeAlias = Literal["directed", "undirected", "texture", "blocks", "zero"]
Texture: TypeAlias = Literal["vlfeat", "dpm"]
Outside: TypeAlias = Literal["repeat", "drop", "missing"]
BlockForm: TypeAlias = Literal["L1", "L1-sqrt", "L2", "L2-Hys"]
PARTS: tuple[Part, ...] = get_args(Part)
HISTOGRAMS: tuple[Part, ...] = ("directed", "undirected", "blocks")


@dataclass(frozen=True)
class GlobalNorm:
    """One normaliser for the whole descriptor, Eq. 7.

    Attributes:
        epsilon: the small positive constant ε, in units of votes on images of the spec's ``value_range``.
        form: ``"printed"`` is v / √(‖v‖ + ε), letter by letter what Eq. 7 says; ``"robust"`` is v / √(‖v‖² + ε²),
            Dalal and Triggs's L2-norm, which the paper's prose names.
    """

    epsilon: float = 1e-5
    form: GlobalForm = "printed"
    kind: ClassVar[str] = "global"

    def __post_init__(self) -> None:
        check_positive("epsilon", self.epsilon)
        check_choice("form", self.form, GlobalForm)

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` orientation bins."""
        return bins

    def grid(self, rows: int, cols: int) -> tuple[int, int]:
        """Rows and columns of the descriptor of so many cells."""
        return rows, cols


@dataclass(frozen=True)
class FourBlockNorm:
    """The UoCTTI normaliser: each cell by the four 2x2-cell blocks it lies in (VLFeat ``vl/hog.c``).

    The energy of a block is the sum of squares of its cells' contrast-insensitive histograms.  A spec whose bins are
    not signed has no other; its parts are made of these.  The channels are the ½-weighted sums over the four blocks of
    the clipped directed (2n) and undirected (n) histograms, and four texture channels.

    Attributes:
        epsilon: see ``floor``; absolute, in squared votes at the spec's ``value_range``, or in votes if it is a floor.
        clip: upper bound of a normalised entry.
        parts: which of these channels the descriptor has, in this order, not texture or zero alone: ``"directed"``,
            ``"undirected"``, ``"texture"``, ``"blocks"`` (4n: the clipped undirected histogram for each block, not
            summed) and ``"zero"`` (one that is 0 in cells of an image; DPM's truncation).
        texture: ``"vlfeat"``: Σ of the clipped undirected histogram / √18 for the blocks up-left, up-right, down-left,
            down-right; ``"dpm"``: 0.2357 · Σ of the clipped directed one, in the order down-right, up-right, down-left,
            up-left.
        outside: blocks that reach beyond the grid.  ``"repeat"``: cells there repeat the edge; ``"drop"``: the
            outermost cells, which lie in them, are not part of the descriptor; ``"missing"``: they add nothing.
        floor: a block divides by √(energy + ε); if true, by √energy, but at least by ε.
    """

    epsilon: float = 1e-4
    clip: float = 0.2
    parts: tuple[Part, ...] = ("directed", "undirected", "texture")
    texture: Texture = "vlfeat"
    outside: Outside = "repeat"
    floor: bool = False
    kind: ClassVar[str] = "four-block"

    def __post_init__(self) -> None:
        check_positive("epsilon", self.epsilon)
        check_positive("clip", self.clip)
        ordered = (some for n in range(1, 1 + len(PARTS)) for some in itertools.combinations(PARTS, n))
        allowed = [parts for parts in ordered if {*parts} & {*HISTOGRAMS}]
        if self.parts not in allowed:
            raise ValueError(
                f"parts must be a tuple of {', '.join(map(repr, PARTS))}, in this order, not of texture or zero alone, "
                f"got {self.parts!r}"
            )
        check_choice("texture", self.texture, Texture)
        check_choice("outside", self.outside, Outside)
        if not isinstance(self.floor, bool):
            raise ValueError(f"floor must be True or False, got {self.floor!r}")

    def channels_of(self, part: Part, bins: int) -> int:
        """Channels of one part, 0 if it is left out: of ``bins`` = 2n directed bins 2n, n, 4, 4n and 1."""
        if part not in self.parts:
            return 0
        return {"directed": bins, "undirected": bins // 2, "texture": 4, "blocks": 2 * bins, "zero": 1}[part]

    @property
    def needs_directed(self) -> bool:
        """Whether some channel is made from directed histograms."""
        return "directed" in self.parts or (self.texture == "dpm" and "texture" in self.parts)

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` = 2n directed orientation bins: 3n + 4 with the first three parts."""
        return sum(self.channels_of(part, bins) for part in PARTS)

    def grid(self, rows: int, cols: int) -> tuple[int, int]:
        """Rows and columns of the descriptor of so many cells."""
        return (rows - 2, cols - 2) if self.outside == "drop" else (rows, cols)


@dataclass(frozen=True)
class BlockNorm:
    """Rectangular blocks of cells, each normalised for itself (scikit-image ``feature/_hog.py``, OpenCV ``hog.cpp``).

    A block's channels are those of its cells, row by row of cells.

    Attributes:
        block: (rows, cols) of cells in a block.
        step: (rows, cols) of cells from one block to the next.
        form: of a block's vector v.  ``"L1"``: v / (Σ|v| + ε); ``"L1-sqrt"``: the root of that, whose derivative at an
            empty entry counts as 0; ``"L2"``: v / √(Σv² + ε²); ``"L2-Hys"``: L2, clipped, and L2 with ε₂ again.
        epsilon: ε, in votes at the spec's ``value_range``.
        epsilon_again: ε₂ of L2-Hys, without unit.
        epsilon_outside_root: whether ε and ε₂ are added to the root of L2 and L2-Hys, √Σv² + ε, as in OpenCV.
        clip: of L2-Hys.
    """

    block: tuple[int, int]
    step: tuple[int, int] = (1, 1)
    form: BlockForm = "L2-Hys"
    epsilon: float = 1e-5
    epsilon_again: float = 1e-5
    epsilon_outside_root: bool = False
    clip: float = 0.2
    kind: ClassVar[str] = "block"

    def __post_init__(self) -> None:
        check_pair("block", self.block)
        check_pair("step", self.step)
        check_choice("form", self.form, BlockForm)
        for name in ("epsilon", "epsilon_again", "clip"):
            check_positive(name, getattr(self, name))
        if not isinstance(self.epsilon_outside_root, bool):
            raise ValueError(f"epsilon_outside_root must be True or False, got {self.epsilon_outside_root!r}")

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` orientation bins."""
        return self.block[0] * self.block[1] * bins

    def grid(self, rows: int, cols: int) -> tuple[int, int]:
        """Rows and columns of blocks of so many cells; below 1 if there is none."""
        height, width = ((n - b) // s + 1 for n, b, s in zip((rows, cols), self.block, self.step, strict=True))
        return height, width


@dataclass(frozen=True)
class CellNorm:
    """Each cell's histogram for itself: v / max(‖v‖, ε) (MaskFeat).

    Attributes:
        epsilon: ε, in votes at the spec's ``value_range``.
    """

    epsilon: float = 1e-12
    kind: ClassVar[str] = "cell"

    def __post_init__(self) -> None:
        check_positive("epsilon", self.epsilon)

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` orientation bins."""
        return bins

    def grid(self, rows: int, cols: int) -> tuple[int, int]:
        """Rows and columns of the descriptor of so many cells."""
        return rows, cols


Normalizer: TypeAlias = GlobalNorm | FourBlockNorm | BlockNorm | CellNorm
NORMALIZERS: dict[str, type[Normalizer]] = {n.kind: n for n in (GlobalNorm, FourBlockNorm, BlockNorm, CellNorm)}
