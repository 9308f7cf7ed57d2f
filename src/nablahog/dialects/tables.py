"""A comparison as tables: for the terminal, an HTML page, CSV and JSON."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..hog import HOGSpec
from ..hog.normalizers import Normalizer
from ..hog.orientation import bin_angles
from ..hog.poolings import Pooling
from ..viz.html import Shown
from .common_form import DIRECTIONS
from .compare import Comparison, Pair, cliques
from .distances import SAME, Distance
from .ties import Ties

LEAST = 0.005  # of a squared distance; smaller contributions are in the CSV file only

_OF_PAIRS = ("a", "b", "compared", "rows", "cols", "distance", "largest", "rms")
CSV_HEADS = (*_OF_PAIRS, "convention", "a_says", "b_says", "share", "percent")

DEFINITIONS = {
    "distance": "‖a − b‖ of what two descriptors say of the strength of gradients by cell and orientation, each scaled "
    "to length 1: 0 if they are equal, √2 = 1.414 if they have nothing in common. It is measured in a common form: "
    "opposite bins are added; of four-block descriptors the contrast-insensitive channels count; of blocks the mean "
    "over all that a cell lies in, without OpenCV's Gaussian; of separate colours their mean. Entries are interpolated "
    f"linearly between the centres of bins and read at {DIRECTIONS} directions, {180 // DIRECTIONS}° apart, among "
    "which are the centres of 9 bins, wherever the first begins. Only cells count that both descriptors, and all "
    "mixtures of both, have. Texture and the sign of contrast do not count.",
    "shares": "What each convention contributes to the squared distance: conventions of the one are exchanged for "
    "those of the other, one after the other, and the share is the mean, over all orders and both ways, of how much "
    "closer each brings them (Shapley value). Below 0: it brings them further apart. “This + that”: neither can be "
    "exchanged alone. Shares below half a percent are not shown.",
    "same": f"No further apart than {SAME:g}, which is rounding.",
    "largest, RMS": "Largest and root mean square difference of the entries as the libraries return them, of the "
    "channels that mean the same in both and the cells that both have; the texture channels in the order that each has "
    "them in. Here, distance and shares are of these entries, too.",
    "between two bins": "Of the pixels with a gradient (of separate colours, three a pixel), the share whose gradient "
    "points exactly between two bins, and is counted in one of them by a rule, for hard votes. Directions are degrees "
    "from +x to +y, downwards; 90° is a gradient straight down, that of a horizontal edge.",
    "between two channels": "The share whose largest gradient two channels have, in different directions, so that a "
    "rule says which one counts.",
}
"""Definitions of the figures, printed under the tables."""


def matrix(comparison: Comparison) -> list[dict[str, object]]:
    """All distances; columns are called by the numbers of the dialects."""
    names = comparison.by_likeness()
    rows = comparison.matrix(names).tolist()
    return [
        {
            "distance": f"{i} {name}",
            **{str(j): None if i == j else distance for j, distance in enumerate(row, start=1)},
        }
        for i, (name, row) in enumerate(zip(names, rows, strict=True), start=1)
    ]


def pairs(comparison: Comparison) -> list[dict[str, object]]:
    """Every pair with the contributions of conventions, the closest first."""
    closest_first = sorted(comparison.pairs, key=lambda pair: pair.orientations.distance)
    return [{"pair": named(pair), **_row(pair.orientations)} for pair in closest_first]


def channels(comparison: Comparison) -> list[dict[str, object]]:
    """The pairs with channels of the same meaning, the closest first."""
    pairs = [(pair, pair.channels) for pair in comparison.pairs if pair.channels]
    return [
        {
            "pair": named(pair),
            "channels": ", ".join(pair.parts),
            "largest": short(distance.largest),
            "RMS": short(distance.rms),
            **_row(distance),
        }
        for pair, distance in sorted(pairs, key=lambda each: each[1].rms)
    ]


def named(pair: Pair) -> str:
    """The names of both."""
    return f"{pair.a} – {pair.b}"


def _row(distance: Distance) -> dict[str, object]:
    return {"distance": distance.distance, "shares of the squared distance": shares(distance)}


def shares(distance: Distance) -> str:
    """The contributions to a squared distance in percent, the largest first."""
    if distance.same:
        return "the same"
    squared = distance.distance**2
    large = [each for each in distance.contributions if abs(each.value) >= LEAST * squared]
    return ", ".join(f"{each.convention.name} {_percent(each.value / squared)}" for each in large)


def short(value: float) -> Shown:
    """A number with two significant digits."""
    return Shown(value, f"{value:#.2g}" if value else "0")


def _percent(share: float, decimals: int = 0) -> str:
    return f"{100 * share:.{decimals}f}%".replace("-", "−")


def tie_rows(ties: Mapping[str, Ties]) -> list[dict[str, object]]:
    """The ties of each dialect, one row for each."""
    return [
        {
            "preset": name,
            "gradients": each.gradients,
            "between two bins": _tied(each.between_bins),
            "at": ", ".join(f"{angle:g}°" for angle in each.directions) if each.directions else None,
            "between two channels": _tied(each.between_colours),
        }
        for name, each in ties.items()
    ]


def _tied(share: float | None) -> Shown | None:
    return None if share is None else Shown(share, _percent(share, 1))


def same(comparison: Comparison) -> list[str]:
    """A sentence for each group of dialects with the same descriptors, in the common form or in some channels."""
    equal: dict[str, list[tuple[str, str]]] = {"The same in a common form": []}
    for pair in comparison.pairs:
        if pair.orientations.same:
            equal["The same in a common form"].append((pair.a, pair.b))
    for pair in comparison.pairs:
        if pair.channels and pair.channels.same:
            equal.setdefault(f"The same {', '.join(pair.parts)} channels", []).append((pair.a, pair.b))
    names = list(comparison.specs)
    return [f"{what}: {', '.join(group)}." for what, pairs in equal.items() for group in cliques(names, pairs)]


def conventions(specs: Mapping[str, HOGSpec]) -> list[dict[str, object]]:
    """The conventions of each spec, one row for each."""
    return [
        {
            "preset": name,
            "image": f"0…{spec.value_range:g}" + (", root" if spec.gamma == "sqrt" else ""),
            "colour": spec.colour + (f", ties {spec.colour_ties}" if spec.colour == "largest" else ""),
            "gradient": f"{spec.mask}, border {spec.border}",
            "bins": f"{spec.bins} over {360 if spec.signed else 180}°, first at {_first_bin(spec):g}°",
            "votes": _votes(spec),
            "cells": f"{_plain(spec.partial_cells)}, {_part(spec.pooling)}",
            "normaliser": _part(spec.normalizer),
            "channels": spec.channels,
            "layout": spec.layout,
        }
        for name, spec in specs.items()
    ]


def _first_bin(spec: HOGSpec) -> float:
    return math.degrees(float(bin_angles(spec)[0])) % math.degrees(spec.period)


def _votes(spec: HOGSpec) -> str:
    if spec.vote == "linear":
        return "linear" if spec.angle == "exact" else f"linear, angle {spec.angle}"
    return f"hard, ties {spec.boundary}" + (f", {spec.directions}" if spec.boundary == "first" else "")


def _part(part: Pooling | Normalizer) -> str:
    fields = (f"{each.name.replace('_', ' ')} {_plain(getattr(part, each.name))}" for each in dataclasses.fields(part))
    return ", ".join([part.kind, *fields])


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ("x" if isinstance(value[0], int) else " + ").join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def csv_rows(comparison: Comparison) -> Iterator[Sequence[object]]:
    """A row for each convention of each pair, for distances in the common form and for those in channels."""
    yield CSV_HEADS
    for pair in comparison.pairs:
        for compared, distance in (("common form", pair.orientations), (" ".join(pair.parts), pair.channels)):
            if distance is not None:
                yield from _csv_rows(pair, compared, distance)


def _csv_rows(pair: Pair, compared: str, distance: Distance) -> Iterator[Sequence[object]]:
    plain = (distance.largest, distance.rms) if distance is pair.channels else (None, None)
    start = (pair.a, pair.b, compared, distance.region.height, distance.region.width, distance.distance, *plain)
    for each in distance.contributions:
        percent = 100 * each.value / distance.distance**2
        yield (*start, each.convention.name, *each.settings, each.value, percent)
    if not distance.contributions:
        yield (*start, None, None, None, None, None)


def csv_ties(ties: Mapping[str, Ties]) -> Iterator[Sequence[object]]:
    """The ties of each dialect as shares of its gradients, one row for each."""
    yield "preset", "gradients", "between_bins", "between_colours", "directions"
    for name, each in ties.items():
        directions = " ".join(f"{angle:g}" for angle in each.directions)
        yield name, each.gradients, each.between_bins, each.between_colours, directions


def figures(comparison: Comparison) -> dict[str, Any]:
    """The comparison as JSON."""
    return {
        "presets": {name: json.loads(spec.to_json()) for name, spec in comparison.specs.items()},
        "pairs": [
            {
                "a": pair.a,
                "b": pair.b,
                "common_form": _figures(pair.orientations),
                "channels": None
                if pair.channels is None
                else {
                    "parts": list(pair.parts),
                    "largest": pair.channels.largest,
                    "rms": pair.channels.rms,
                    **_figures(pair.channels),
                },
            }
            for pair in comparison.pairs
        ],
        "ties": {name: vars(each) for name, each in comparison.ties.items()},
        "definitions": DEFINITIONS,
    }


def _figures(distance: Distance) -> dict[str, Any]:
    return {
        "distance": distance.distance,
        "same": distance.same,
        "cells": distance.region._asdict(),
        "shares": [
            {"convention": each.convention.name, "a": each.settings[0], "b": each.settings[1], "share": each.value}
            for each in distance.contributions
        ],
    }
