"""HOGSpec: every convention of a HOG dialect, by name.

A HOG is four steps in a row: gradient, votes, pooling, normaliser.  Libraries differ in small conventions inside each
step; a :class:`HOGSpec` states all of them, so that a descriptor and its spec together are enough to compute, compare
or invert it.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import sys
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias, get_args

Colour: TypeAlias = Literal["gray", "largest"]
Border: TypeAlias = Literal["reflect", "replicate", "zero", "ignore"]
Vote: TypeAlias = Literal["linear", "hard"]
PartialCells: TypeAlias = Literal["floor", "round", "ceil"]
GlobalForm: TypeAlias = Literal["printed", "robust"]
Part: TypeAlias = Literal["directed", "undirected", "texture"]
PARTS: tuple[Part, ...] = get_args(Part)


def _check_choice(field: str, value: object, choices: Any) -> None:
    allowed = get_args(choices)
    if value not in allowed:
        raise ValueError(f"{field} must be one of {', '.join(map(repr, allowed))}, got {value!r}")


def _check_positive(field: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= sys.float_info.max:
        raise ValueError(f"{field} must be a finite number above 0, got {value!r}")


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
        _check_positive("epsilon", self.epsilon)
        _check_choice("form", self.form, GlobalForm)

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` orientation bins."""
        return bins


@dataclass(frozen=True)
class FourBlockNorm:
    """The UoCTTI normaliser: each cell by the four 2x2-cell blocks it lies in (VLFeat ``vl/hog.c``).

    The energy of a block is the sum of squares of its cells' contrast-insensitive histograms; cells beyond the grid
    repeat the edge.  The channels are the ½-weighted sums over the four blocks of the clipped directed (2n) and
    undirected (n) histograms, and four texture channels, Σ of the clipped undirected histogram / √18, for the
    blocks up-left, up-right, down-left, down-right.

    Attributes:
        epsilon: added to a block's energy under the root; absolute, in squared votes at the spec's ``value_range``.
        clip: upper bound of a normalised entry.
        parts: which of these channels the descriptor has: all, or some of ``"directed"``, ``"undirected"`` and
            ``"texture"``, in this order, but not texture alone.
    """

    epsilon: float = 1e-4
    clip: float = 0.2
    parts: tuple[Part, ...] = PARTS
    kind: ClassVar[str] = "four-block"

    def __post_init__(self) -> None:
        _check_positive("epsilon", self.epsilon)
        _check_positive("clip", self.clip)
        allowed = [parts for n in (1, 2, 3) for parts in itertools.combinations(PARTS, n) if parts != ("texture",)]
        if self.parts not in allowed:
            raise ValueError(
                f"parts must be a tuple of {', '.join(map(repr, PARTS))}, in this order, not of the last alone, "
                f"got {self.parts!r}"
            )

    def channels_of(self, part: Part, bins: int) -> int:
        """Channels of one part, 0 if it is left out: of ``bins`` = 2n directed orientation bins 2n, n and 4."""
        return {"directed": bins, "undirected": bins // 2, "texture": 4}[part] if part in self.parts else 0

    def channels(self, bins: int) -> int:
        """Descriptor channels made from ``bins`` = 2n directed orientation bins: 3n + 4 with all parts."""
        return sum(self.channels_of(part, bins) for part in PARTS)


Normalizer: TypeAlias = GlobalNorm | FourBlockNorm
_NORMALIZERS: dict[str, type[GlobalNorm] | type[FourBlockNorm]] = {n.kind: n for n in (GlobalNorm, FourBlockNorm)}


@dataclass(frozen=True)
class HOGSpec:
    """All conventions of one HOG dialect.  Immutable; change a field with :func:`dataclasses.replace`.

    Attributes:
        name: what people call this dialect; only shown, never interpreted.
        value_range: the largest value of the images that the constants ε were made for (1 or 255).  The operator
            multiplies an image in 0…1 by it.
        colour: ``"gray"``, one gray image before differentiation (Eq. 1); ``"largest"``, at each pixel the channel of
            largest gradient magnitude, the first on ties.
        border: derivative across the image border (Eq. 2).  ``"reflect"``: 0, as with a mirrored image;
            ``"replicate"``: the one-sided difference; ``"zero"``: black beyond the border; ``"ignore"``: pixels of the
            outermost ring cast no votes.
        bins: number of orientation bins over 180° (unsigned) or 360° (signed).
        signed: whether opposite gradients vote into different bins.
        bin_offset: bin k is centred at (k + bin_offset) · period / bins; angles start at +x and grow from +x to +y,
            that is clockwise on screen.
        vote: ``"linear"``, shared between the two nearest bins (Eq. 3-4); ``"hard"``, all to the bin direction of
            largest dot product, the first on ties.
        cell_size: (height, width) of a cell in pixels.
        partial_cells: how many cells n pixels make with cells of c: ``"floor"`` ⌊n/c⌋, ``"round"`` ⌊(n + ⌊c/2⌋)/c⌋,
            ``"ceil"`` ⌈n/c⌉.  Pixels beyond the last cell's centre still vote into it, with their bilinear weight.
        normalizer: a :class:`GlobalNorm` or a :class:`FourBlockNorm`.

    Raises:
        ValueError: a field is out of its range, or two fields contradict each other.
    """

    name: str
    value_range: float
    colour: Colour
    border: Border
    bins: int
    signed: bool
    bin_offset: float
    vote: Vote
    cell_size: tuple[int, int]
    partial_cells: PartialCells
    normalizer: Normalizer

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueError(f"name must be text, got {self.name!r}")
        _check_positive("value_range", self.value_range)
        _check_choice("colour", self.colour, Colour)
        _check_choice("border", self.border, Border)
        _check_choice("vote", self.vote, Vote)
        _check_choice("partial_cells", self.partial_cells, PartialCells)
        if not isinstance(self.bins, int) or self.bins < 3:
            raise ValueError(f"bins must be an integer of at least 3, got {self.bins!r}")
        if not isinstance(self.signed, bool):
            raise ValueError(f"signed must be True or False, got {self.signed!r}")
        if not isinstance(self.bin_offset, int | float) or not 0 <= self.bin_offset < 1:
            raise ValueError(f"bin_offset must lie in [0, 1), in bins, got {self.bin_offset!r}")
        size = self.cell_size
        if not (isinstance(size, tuple) and len(size) == 2 and all(type(c) is int and c >= 1 for c in size)):
            raise ValueError(f"cell_size must be a pair (height, width) of integers of at least 1, got {size!r}")
        needs_opposites = isinstance(self.normalizer, FourBlockNorm) or (self.signed and self.vote == "hard")
        if needs_opposites and (not self.signed or self.bins % 2):
            raise ValueError(
                f"a four-block normaliser, or hard signed votes, pair each bin with its opposite: "
                f"signed must be True and bins even, got signed={self.signed}, bins={self.bins}"
            )

    @property
    def period(self) -> float:
        """Range of orientations in radians: π unsigned, 2π signed."""
        return 2 * math.pi if self.signed else math.pi

    @property
    def channels(self) -> int:
        """Length of the descriptor of one cell."""
        return self.normalizer.channels(self.bins)

    def grid(self, height: int, width: int) -> tuple[int, int]:
        """Rows and columns of cells of an image of ``height`` x ``width`` pixels.

        Raises:
            ValueError: the image holds no cell.
        """
        rows, cols = (self._cells(n, c) for n, c in zip((height, width), self.cell_size, strict=True))
        if rows < 1 or cols < 1:
            raise ValueError(
                f"the image must hold at least one cell of {self.cell_size[0]}x{self.cell_size[1]} pixels "
                f"(height x width), got an image of {height}x{width}"
            )
        return rows, cols

    def _cells(self, pixels: int, cell: int) -> int:
        if self.partial_cells == "floor":
            return pixels // cell
        return (pixels + cell // 2) // cell if self.partial_cells == "round" else -(-pixels // cell)

    def check_same(self, other: HOGSpec, learned: str) -> None:
        """Raises ValueError if ``other`` is another dialect than this one, of which ``learned`` was learned."""
        for field in dataclasses.fields(self):
            ours, theirs = getattr(self, field.name), getattr(other, field.name)
            if field.name != "name" and ours != theirs:  # a name decides nothing
                raise ValueError(
                    f"{learned} was learned for another spec: its {field.name} is {ours!r}, "
                    f"the {other.name} descriptor's {theirs!r}"
                )

    def to_json(self) -> str:
        """This spec as one line of JSON, read back by :meth:`from_json`."""
        fields = dataclasses.asdict(self)
        fields["normalizer"]["kind"] = self.normalizer.kind
        return json.dumps(fields)

    @classmethod
    def from_json(cls, text: str) -> HOGSpec:
        """The spec that :meth:`to_json` wrote.

        Raises:
            ValueError: the text is not JSON, or names unknown, missing or invalid fields.
        """
        try:
            fields = json.loads(text)
            normalizer = dict(fields.pop("normalizer"))
            kind = normalizer.pop("kind")
            if "parts" in normalizer:  # which the first version did not know
                normalizer["parts"] = tuple(normalizer["parts"])
            fields["normalizer"] = _NORMALIZERS[kind](**normalizer)
            fields["cell_size"] = tuple(fields["cell_size"])
            return cls(**fields)
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"not the JSON of a HOGSpec: {error!s}") from None
