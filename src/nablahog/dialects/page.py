"""A comparison of dialects as an HTML page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ..hog.descriptor import describe
from ..viz import html
from ..viz.pictures import Panel, glyphs
from . import tables
from .compare import Comparison


def lead(comparison: Comparison, photograph: str, size: tuple[int, int], shrunk: bool) -> str:
    """A sentence on what is compared.

    Args:
        comparison: of the dialects.
        photograph: its name.
        size: (height, width) compared.
        shrunk: whether the photograph was larger.
    """
    (height, width), cell = size, next(iter(comparison.specs.values())).cell_size
    how = "shrunk to" if shrunk else "of"
    return (
        f"How far apart the HOGs of {len(comparison.specs)} presets are on {photograph}, {how} {height}x{width} pixels "
        f"(height x width) and rounded to 8 bits, all with cells of {cell[0]}x{cell[1]} pixels, and which of their "
        "conventions that is."
    )


def page(comparison: Comparison, image: Tensor, introduction: str, picture: NDArray[np.float64]) -> str:
    """The page.

    Args:
        comparison: of the dialects.
        image: the photograph, (C, H, W), uint8.
        introduction: see :func:`lead`.
        picture: of the distances, see :func:`.heatmap.heat_map`.
    """
    specs = comparison.specs.items()
    drawn = [Panel(glyphs(describe(image.unsqueeze(0), spec)[0], spec), name) for name, spec in specs]
    sections = [
        html.Section(
            "Distances", "The darker the further apart; neighbours are alike.", [Panel(picture, "all distances")]
        ),
        html.Section("Why", "Every pair, the closest first.", table=tables.pairs(comparison)),
        html.Section(
            "Channels with the same meaning",
            "Pairs of which some channels mean the same in both: their entries compared as they are.",
            table=tables.channels(comparison),
        ),
        html.Section(
            "Ties",
            "8-bit values make gradients that lie exactly between two bins, or are equal in two channels. Libraries "
            "have different rules for these.",
            table=tables.tie_rows(comparison.ties),
        ),
        html.Section(
            "What each says of the photograph",
            "The descriptors as glyphs: in each cell, strokes along its edges.",
            [Panel(image / 255, "the photograph"), *drawn],
        ),
        html.Section("The presets", "Their conventions.", table=tables.conventions(comparison.specs)),
    ]
    return html.page(
        "Dialects of HOG",
        " ".join([introduction, *tables.same(comparison)]),
        [],
        sections,
        tables.DEFINITIONS,
        html.footer("dialects.csv and ties.csv beside this page"),
    )
