"""The tables of presets on the pages, from their docstrings, specs and stored outputs; `make generated` writes them."""

from __future__ import annotations

import dataclasses
import inspect
from collections import Counter
from typing import Any

from nablahog.hog import HOGSpec, presets
from tests.golden import PEERS, cases

SPECS: dict[str, HOGSpec] = {
    name: getattr(presets, name)(8) if name in ("aubry", "seeing3d") else getattr(presets, name)()
    for name in presets.__all__
}
"""With cells of 8 pixels."""

_TIES = {
    "first": "",
    "opencv": "; of equals the first, but the last in the width mod 4 last columns",
    "dlib": "; of equals the last, but the first in a few last columns",
}
_COLOUR = {"gray": "gray", "largest": "largest channel", "separate": "each by itself"}
_MASK = {"central": "[-1,0,1]", "sobel": "Sobel"}
_BORDER = {
    "reflect": "mirrored",
    "replicate": "one-sided at the border",
    "extrapolate": "twice the one-sided difference at the border",
    "zero": "black outside",
    "gray": "middle gray outside",
    "ignore": "the outermost ring does not vote",
}
_ANGLE = {"exact": "", "opencv": ", by an angle off by up to 3e-4", "vlfeat": ", by an arccosine in float32"}
_DIRECTIONS = {"float32": "", "four-decimals": ", directions to 4 decimals"}
_CELLS = {"floor": "⌊·⌋", "round": "⌊·⌉", "ceil": "⌈·⌉"}


def table(*rows: tuple[str, ...]) -> str:
    """Rows of Markdown, of which the first is the head."""
    head, *body = (f"| {' | '.join(row)} |\n" for row in rows)
    return f"{head}|{'---|' * len(rows[0])}\n{''.join(body)}"


def summary(name: str) -> str:
    """The first sentence of a preset's docstring."""
    return (
        (inspect.getdoc(getattr(presets, name)) or "")
        .partition("\n")[0]
        .partition(".  ")[0]
        .replace("``", "`")
        .rstrip(".")
    )


def choices() -> str:
    """What each preset computes, and how many outputs of the original it is compared with."""
    count = Counter(case.preset for peer in PEERS for case in cases(peer))
    rows = [(f"`{name}`", summary(name), str(count[name] or "–")) for name in SPECS]
    return table(("preset", "computes", "stored outputs"), *rows)


def counts() -> str:
    """The numbers for each place, and the number of places, of each preset."""
    rows = sorted((spec.channels, _places(spec), f"`{name}`", summary(name)) for name, spec in SPECS.items())
    return table(
        ("numbers for each place", "places", "preset", "it may be"), *((str(row[0]), *row[1:]) for row in rows)
    )


def _places(spec: HOGSpec) -> str:
    """How many rows and columns images of H×W pixels have."""
    height, width = 100, 76  # 12.5 x 9.5 cells of 8 pixels
    left, right = _CELLS[spec.partial_cells].split("·")
    sides = []
    for side, pixels, count in zip("HW", (height, width), spec.grid(height, width), strict=True):
        fewer = int(pixels / 8 + 0.5 * (spec.partial_cells == "round")) - count
        cells = f"{left}{side}/c{right}"
        sides.append(f"({cells} − {fewer})" if fewer else cells)
    return " × ".join(sides)


def conventions() -> str:
    """The conventions of each preset."""
    head = ("preset", "image", "colour", "derivative, border", "bins", "vote", "exactly between two bins", "cells")
    return table((*head, "pooling", "normaliser"), *(_row(name, spec) for name, spec in SPECS.items()))


def _row(name: str, spec: HOGSpec) -> tuple[str, ...]:
    degrees = 360 if spec.signed else 180
    first = spec.bin_offset * degrees / spec.bins
    places = f"{-first % degrees:g}° and falling" if spec.counterclockwise else f"{first:g}°"
    hard = "all to one" + _DIRECTIONS[spec.directions]
    boundary = "–" if spec.vote == "linear" else "the lower bin" if spec.boundary == "first" else "the upper bin"
    return (
        f"`{name}`",
        f"0…{spec.value_range:g}{', its root' if spec.gamma == 'sqrt' else ''}",
        _COLOUR[spec.colour] + _TIES[spec.colour_ties],
        f"{_MASK[spec.mask]}, {_BORDER[spec.border]}",
        f"{spec.bins} over {degrees}°, first at {places}",
        f"shared{_ANGLE[spec.angle]}" if spec.vote == "linear" else hard,
        boundary,
        _CELLS[spec.partial_cells],
        _part(spec.pooling),
        _part(spec.normalizer),
    )


def _part(part: Any) -> str:
    """The class of a part, with its constants: those that are not its defaults, and ε and the clip always."""
    shown = [
        f"{each.name} {_value(getattr(part, each.name))}"
        for each in dataclasses.fields(part)
        if each.name in ("epsilon", "clip") or getattr(part, each.name) != each.default
    ]
    return f"{{class}}`~nablahog.hog.{type(part).__name__}`{': ' if shown else ''}{', '.join(shown)}"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return ("x" if isinstance(value[0], int) else "+").join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower()
