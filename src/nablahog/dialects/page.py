"""A comparison of dialects as an HTML page."""

from __future__ import annotations

from torch import Tensor

from ..hog.engines import describe
from ..viz import html
from ..viz.pictures import Panel, glyphs
from ..viz.svg import Drawing
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


def page(comparison: Comparison, image: Tensor, introduction: str, distances: Drawing) -> str:
    """The page.

    Args:
        comparison: of the dialects.
        image: the photograph, (C, H, W), uint8.
        introduction: see :func:`lead`.
        distances: drawn by :func:`.heatmap.heat_map`.
    """
    drawn = [
        Panel(
            glyphs(describe(image.unsqueeze(0), spec)[0], spec),
            name,
            f"Strokes along the edges of the photograph, cell by cell, of its {name} HOG",
        )
        for name, spec in comparison.specs.items()
    ]
    sections = [
        html.Section(
            "Distances", "The stronger the colour the further apart; neighbours are alike.", drawings=[distances]
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
            [Panel(image / 255, "the photograph", "The photograph that all of them describe"), *drawn],
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
