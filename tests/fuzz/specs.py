"""Any dialect, with images that suit it."""

from __future__ import annotations

import itertools
from typing import Any, TypeAlias, get_args

from hypothesis import strategies as st

from nablahog.hog import (
    BilinearCells,
    BlockCells,
    BlockNorm,
    BoxCells,
    CellNorm,
    FourBlockNorm,
    GlobalNorm,
    HOGSpec,
)
from nablahog.hog.normalizers.four_block import PARTS
from nablahog.hog.spec import Border, Boundary, Colour, ColourTies, Derivative, Directions, Gamma, Mask, PartialCells

from ..hog.zoo import fits

PARTS_LISTS = [
    parts
    for n in range(1, 1 + len(PARTS))
    for parts in itertools.combinations(PARTS, n)
    if {*parts} & {"directed", "undirected", "blocks"}
]
sides = st.integers(1, 6)
pairs = st.tuples(sides, sides)
numbers = st.one_of(st.floats(0.01, 10), st.sampled_from([1e-12, 1e-6, 1e-3, 0.1, 1.0, 100.0, 1e6, 1e12]))
FORMS = ("L1", "L1-sqrt", "L2", "L2-Hys")
CHOICES = {
    "border": Border,
    "partial_cells": PartialCells,
    "mask": Mask,
    "gamma": Gamma,
    "colour_ties": ColourTies,
    "directions": Directions,
    "derivative": Derivative,
    "boundary": Boundary,
}


@st.composite
def normalizers(draw: st.DrawFn) -> Any:
    return draw(
        st.one_of(
            st.builds(GlobalNorm, numbers, st.sampled_from(["printed", "robust"])),
            st.builds(CellNorm, numbers),
            st.builds(
                BlockNorm, pairs, pairs, st.sampled_from(FORMS), numbers, numbers, st.booleans(), st.floats(0.05, 1)
            ),
            st.builds(
                FourBlockNorm,
                numbers,
                st.floats(0.05, 1),
                st.sampled_from(PARTS_LISTS),
                st.sampled_from(["vlfeat", "dpm"]),
                st.sampled_from(["repeat", "drop", "missing"]),
                st.booleans(),
            ),
        )
    )


@st.composite
def specs(draw: st.DrawFn) -> HOGSpec:
    """Any dialect whose images may be small."""
    cell, normalizer = draw(pairs), draw(normalizers())
    pooling: Any = draw(
        st.one_of(
            st.builds(BilinearCells, st.sampled_from(["vote", "drop", "repeat"]), st.floats(0.5, 2)),
            st.builds(BoxCells, st.booleans(), st.sampled_from([0, 2, 3, 7])),
        )
    )
    if isinstance(normalizer, BlockNorm) and draw(st.booleans()):  # votes within blocks
        cells = draw(st.tuples(st.integers(1, 3), st.integers(1, 3)))
        normalizer = BlockNorm(cells, cells, normalizer.form, normalizer.epsilon, normalizer.epsilon_again)
        block = cells[0] * cell[0], cells[1] * cell[1]
        pooling = BlockCells(block, draw(st.tuples(st.integers(1, 12), st.integers(1, 12))), draw(st.floats(0.1, 9)))
    four = isinstance(normalizer, FourBlockNorm)
    vote = draw(st.sampled_from(["linear", "hard"]))
    angle = draw(st.sampled_from(["exact", "exact", "opencv", "vlfeat"]))
    signed = (four and normalizer.needs_directed) or draw(st.booleans())
    paired = signed and (vote == "hard" or four or angle == "vlfeat")
    bins = 2 * draw(st.integers(2, 20)) if paired else draw(st.integers(3, 40))
    colour = draw(st.sampled_from(get_args(Colour)))
    layouts = ["cells", "planes", *["colour-planes"] * (colour == "separate")]
    if isinstance(normalizer, BlockNorm) and colour != "separate":
        layouts += ["blocks", "block-vector", "opencv-vector"]
    return HOGSpec(
        name="any",
        value_range=draw(st.sampled_from([1.0, 255.0, 127.5, 0.01])),
        colour=colour,
        bins=bins,
        signed=signed,
        bin_offset=0.0 if angle == "vlfeat" else draw(st.one_of(st.just(0.5), st.floats(0, bins, exclude_max=True))),
        vote=vote,
        cell_size=cell,
        normalizer=normalizer,
        pooling=pooling,
        counterclockwise=angle == "exact" and draw(st.booleans()),
        angle=angle,
        layout=draw(st.sampled_from(layouts)),
        **{name: draw(st.sampled_from(get_args(choices))) for name, choices in CHOICES.items() if name != "mask"},
        mask=draw(st.sampled_from(["central", "central", "central", "sobel"])),  # most of whose borders have no loops
    )


Shape: TypeAlias = tuple[int, int, int, int]
"""(B, C, H, W)"""


@st.composite
def shapes(draw: st.DrawFn, spec: HOGSpec, largest: int = 40) -> Shape:
    """A shape of which there is a descriptor, of at most so many pixels a side unless the spec needs more."""
    channels = draw(st.sampled_from([1, 3])) if spec.colour == "separate" else draw(st.sampled_from([1, 2, 3, 5]))
    batch, *shape = draw(st.integers(1, 3)), channels, draw(st.integers(1, largest)), draw(st.integers(1, largest))
    if not fits(spec, *shape):
        side = next((n for n in range(1, 80) if fits(spec, channels, n, n)), 80)
        shape = [channels, side, side]
    return batch, shape[0], shape[1], shape[2]
