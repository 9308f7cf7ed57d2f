"""HOGSpec: every convention of a HOG dialect, by name.

A HOG is four steps in a row: gradient, votes, pooling, normaliser.  Libraries differ in small conventions inside each
step; a :class:`HOGSpec` states all of them, so that a descriptor and its spec together are enough to compute, compare
or invert it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from ..inputs.numbers import as_integer, as_number, convert_fields, shortened
from ..runtime.text import one_line
from .normalizers import Normalizer
from .poolings import BilinearCells, PartialCells, Pooling

Gamma: TypeAlias = Literal["none", "sqrt"]
Colour: TypeAlias = Literal["gray", "largest", "separate"]
ColourTies: TypeAlias = Literal["first", "opencv", "dlib"]
Mask: TypeAlias = Literal["central", "sobel"]
Border: TypeAlias = Literal["reflect", "replicate", "extrapolate", "zero", "gray", "ignore"]
Vote: TypeAlias = Literal["linear", "hard"]
Angle: TypeAlias = Literal["exact", "opencv", "vlfeat"]
Directions: TypeAlias = Literal["float32", "four-decimals"]
Derivative: TypeAlias = Literal["own", "linear"]
Boundary: TypeAlias = Literal["first", "upper"]
Layout: TypeAlias = Literal["cells", "planes", "colour-planes", "tokens", "blocks", "block-vector", "opencv-vector"]
COLOURS = 3  # of a spec with separate colours
MOST_BINS = 1000


@dataclass(frozen=True)
class HOGSpec:
    """All conventions of one HOG dialect.  Immutable; change a field with :func:`dataclasses.replace`.

    Attributes:
        name: what people call this dialect; only shown, never interpreted.
        value_range: the largest value of the images that the constants ε are meant for (1 or 255).  The operator
            multiplies an image in 0…1 by it.
        colour: ``"gray"``, one gray image before differentiation (Eq. 1); ``"largest"``, at each pixel the channel of
            largest gradient magnitude; ``"separate"``, one for each of three channels; a gray image
            counts as three equal ones.
        border: derivative across the image border (Eq. 2).  ``"reflect"``: 0, as with a mirrored image;
            ``"replicate"``: the one-sided difference; ``"extrapolate"``: twice that, as if the image went on linearly;
            ``"zero"``: black beyond the border; ``"gray"``: 128/255 beyond it; ``"ignore"``: pixels of the outermost
            ring cast no votes.
        bins: number of orientation bins over 180° (unsigned) or 360° (signed).
        signed: whether opposite gradients vote into different bins.
        bin_offset: bin k is centred at (k + bin_offset) · period / bins; angles start at +x and grow from +x to +y,
            which is clockwise on the screen.
        vote: ``"linear"``, shared between the two nearest bins (Eq. 3-4); ``"hard"``, all to the bin direction of
            largest dot product.
        cell_size: (height, width) of a cell in pixels.
        partial_cells: how many cells n pixels make with cells of c: ``"floor"`` ⌊n/c⌋, ``"round"`` ⌊(n + ⌊c/2⌋)/c⌋,
            ``"ceil"`` ⌈n/c⌉.
        normalizer: from histograms to the descriptor, see :mod:`.normalizers`.
        pooling: from votes to histograms of cells, see :mod:`.poolings`.
        gamma: ``"sqrt"``, the root of all values first; its derivative at black counts as 0.
        colour_ties: which of several channels of largest magnitude counts.  ``"first"``; ``"opencv"``: the first, but
            the last in the width % 4 last columns; ``"dlib"``: the last, but the first in the last columns, those left
            by groups of eight from the second column on.
        mask: ``"central"``, [-1, 0, 1]; ``"sobel"``, the same, averaged over three rows or columns with 1, 2, 1.
        counterclockwise: whether bins are numbered against the sense of angles: bin k is then centred at
            -(k + bin_offset) · period / bins.
        angle: of linear votes.  ``"exact"``; ``"opencv"``: its arctangent, a polynomial that errs by up to 3e-4 rad;
            ``"vlfeat"``: its arccosine of a float32, which errs by as much near a bin's centre.  The derivative is that
            of the exact angle.
        directions: of hard votes, the table of sines and cosines: ``"float32"``, or rounded to ``"four-decimals"``.
        derivative: of hard votes.  ``"own"``, through the magnitude only, because the bin does not move; ``"linear"``,
            straight through: that of linear votes.
        boundary: the bin of a gradient exactly between two, of hard votes.  ``"first"`` in the order of bins, as for
            largest dot products; ``"upper"``, the one that begins there.
        layout: the library's own layout of the descriptor, see :mod:`.layout`.

    Raises:
        ValueError: a field is out of its range, or two fields contradict each other.

    >>> spec = nablahog.presets.skimage(orientations=8)
    >>> spec.bins, spec.cell_size, spec.grid(128, 64)  # blocks of an image of 128 rows and 64 columns
    (8, (8, 8), (14, 6))
    >>> nablahog.HOGSpec.from_json(spec.to_json()) == spec
    True
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
    pooling: Pooling = field(default_factory=BilinearCells)
    gamma: Gamma = "none"
    colour_ties: ColourTies = "first"
    mask: Mask = "central"
    counterclockwise: bool = False
    angle: Angle = "exact"
    directions: Directions = "float32"
    derivative: Derivative = "own"
    boundary: Boundary = "first"
    layout: Layout = "cells"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueError(f"name must be text, got {shortened(self.name)}")
        convert_fields(self, "bin_offset")
        as_integer("bins", self.bins, 3, MOST_BINS)
        object.__setattr__(self, "bin_offset", as_number("bin_offset", self.bin_offset, 0, below=self.bins))
        _check_kind("normalizer", self.normalizer, Normalizer.kinds)
        _check_kind("pooling", self.pooling, Pooling.kinds)
        self._check_together()
        # made in advance: torch.compile cannot trace the making of them
        self.__dict__["text"] = self._text()
        if self.colours > 1:
            self.__dict__["gray"] = dataclasses.replace(self, colour="gray", layout="cells")

    def __hash__(self) -> int:
        return hash(self.__dict__["text"])  # a string caches its hash

    def _check_together(self) -> None:
        self.normalizer.check(self.bins, self.signed)
        if self.signed and self.bins % 2 and (self.vote == "hard" or self.angle == "vlfeat"):
            raise ValueError(
                f"hard signed votes, and the angle 'vlfeat', pair each bin with its opposite: bins must be even, got "
                f"{self.bins}"
            )
        if self.angle == "opencv" and self.counterclockwise:
            raise ValueError("the angle 'opencv' goes with clockwise bins: counterclockwise must be False")
        if self.angle == "vlfeat" and (self.bin_offset or self.counterclockwise):
            raise ValueError("the angle 'vlfeat' goes with clockwise bins and bin_offset 0")
        self.pooling.check(self.cell_size, self.normalizer)
        if self.layout == "colour-planes" and self.colour != "separate":
            raise ValueError(f"the layout 'colour-planes' goes with colour 'separate', got {self.colour!r}")
        has_blocks = self.normalizer.layout_block is not None and self.colour != "separate"
        if self.layout in ("blocks", "block-vector", "opencv-vector") and not has_blocks:
            raise ValueError(f"the layout {self.layout!r} goes with a BlockNorm, and not with colour 'separate'")

    @property
    def named(self) -> str:
        """Its name with an article, for sentences."""
        return f"an {self.name}" if self.name[:1] in ("a", "e", "i", "o") else f"a {self.name}"

    @property
    def period(self) -> float:
        """Range of orientations in radians: π unsigned, 2π signed."""
        return 2 * math.pi if self.signed else math.pi

    @property
    def colours(self) -> int:
        """How many channels of an image are described separately."""
        return COLOURS if self.colour == "separate" else 1

    @property
    def channels(self) -> int:
        """Length of the descriptor of one cell, or block."""
        return self.colours * self.normalizer.channels(self.bins, self.signed)

    def cells(self, height: int, width: int) -> tuple[int, int]:
        """Rows and columns of cell histograms of an image of ``height`` x ``width`` pixels.

        Raises:
            ValueError: the image holds no cell.
        """
        pooling, (down, across) = self.pooling, self.cell_size
        rows = pooling.cells(height, down, 0, self.partial_cells)
        cols = pooling.cells(width, across, 1, self.partial_cells)
        if rows < 1 or cols < 1:
            what, size = pooling.smallest(self.cell_size)
            raise ValueError(
                f"the image must hold at least one {what} of {size[0]}x{size[1]} pixels "
                f"(height x width), got an image of {height}x{width}"
            )
        return rows, cols

    def grid(self, height: int, width: int) -> tuple[int, int]:
        """Rows and columns of the descriptor of an image of ``height`` x ``width`` pixels: of cells, or of blocks.

        Raises:
            ValueError: the image is too small to have any.
        """
        cells = self.cells(height, width)
        along = self.normalizer.footprint(0), self.normalizer.footprint(1)
        rows, cols = along[0].count(cells[0]), along[1].count(cells[1])
        if rows < 1 or cols < 1:
            least = f"{along[0].cells(1)}x{along[1].cells(1)}"
            left_out = any(footprint.margin for footprint in along)
            raise ValueError(
                f"an image of {height}x{width} pixels (height x width) has {cells[0]}x{cells[1]} cells, too few for "
                f"{self.named} descriptor: "
                + (f"it leaves the outermost out, and needs at least {least}" if left_out else f"a block has {least}")
            )
        return rows, cols

    def image_size(self, rows: int, cols: int) -> tuple[int, int]:
        """(height, width) of the image of whole cells whose descriptor has these rows and columns."""
        cells = (self.normalizer.footprint(axis).cells(count) for axis, count in enumerate((rows, cols)))
        height, width = (
            self.pooling.first_pixel(count - 1, cell, axis) + cell
            for axis, (count, cell) in enumerate(zip(cells, self.cell_size, strict=True))
        )
        return height, width

    def check_channels(self, channels: int) -> None:
        """Raises ValueError if images with this number of channels have no descriptor."""
        if self.colour == "separate" and channels not in (1, COLOURS):
            raise ValueError(f"{self.named} descriptor needs images of 1 or {COLOURS} channels, got {channels}")

    def check_same(self, other: HOGSpec, learned: str) -> None:
        """Raises ValueError if ``other`` is not this dialect, for which ``learned`` was learned."""
        for attribute in dataclasses.fields(self):
            ours, theirs = getattr(self, attribute.name), getattr(other, attribute.name)
            if attribute.name not in ("name", "layout", "derivative") and ours != theirs:  # these three change no entry
                raise ValueError(
                    f"{learned} was learned for another spec: its {attribute.name} is {ours!r}, "
                    f"the {other.name} descriptor's {theirs!r}"
                )

    def with_linear_votes(self) -> HOGSpec:
        """The continuous counterpart: the same dialect with linear votes by the exact angle."""
        return dataclasses.replace(
            self, vote="linear", angle="exact", directions="float32", derivative="own", boundary="first"
        )

    @property
    def single_colour(self) -> HOGSpec:
        """The same dialect for one channel of an image, if this one describes each channel separately."""
        spec: HOGSpec = self.__dict__.get("gray", self)
        return spec

    def to_json(self) -> str:
        """This spec as one line of JSON, read back by :meth:`from_json`."""
        text: str = self.__dict__["text"]
        return text

    def _text(self) -> str:
        parts = {name: getattr(self, name) for name in ("normalizer", "pooling")}
        stored = {name: {**_fields(part), "kind": part.kind} for name, part in parts.items()}
        return json.dumps(_fields(self) | stored)

    @classmethod
    def from_json(cls, text: str) -> HOGSpec:
        """The spec that :meth:`to_json` wrote, now or before there were more than the first eleven fields.

        Raises:
            ValueError: the text is not JSON, or names unknown, missing or invalid fields.
        """
        try:
            fields = json.loads(text)
            fields["normalizer"] = _part(fields["normalizer"], Normalizer.kinds)
            if "pooling" in fields:
                fields["pooling"] = _part(fields["pooling"], Pooling.kinds)
            return cls(**fields)
        except (KeyError, TypeError, AttributeError, OverflowError, RecursionError, json.JSONDecodeError) as error:
            raise ValueError(f"not the JSON of a HOGSpec: {one_line(error)}") from None
        except ValueError as error:
            raise ValueError(one_line(error)) from None


def _check_kind(field: str, part: Any, kinds: dict[str, Any]) -> None:
    """``part`` is of one of the classes listed."""
    if type(part) not in kinds.values():
        names = ", ".join(part_class.__name__ for part_class in kinds.values())
        raise ValueError(f"{field} must be one of {names}, got {shortened(part)}")


def _fields(instance: Any) -> dict[str, Any]:
    """The values of a dataclass by name; :func:`dataclasses.asdict` would copy each of them, which takes long."""
    return {field.name: getattr(instance, field.name) for field in dataclasses.fields(instance)}


def _part(fields: dict[str, Any], kinds: dict[str, Any]) -> Any:
    """A normaliser or pooling from its JSON."""
    return kinds[fields["kind"]](**{name: value for name, value in fields.items() if name != "kind"})
