"""What detectors look for: figures, pictures and the page of ``nablahog invert --template``."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...invert import Reconstruction
from ...viz import html
from ...viz.pictures import Panel, glyphs
from ..errors import Skipped
from ..inputs.templates import DetectorTemplate
from .inversion_page import SHOWN, skipped_section

SIGNS = {"positive": "for", "negative": "against"}
"""Whether edges with such weights speak for or against a detection."""

LEAD = (
    "The positive weights of a linear detector over a HOG descriptor say which edges speak for a detection, and the "
    "negative ones which speak against it. Beside the glyphs of the weights is an image with such edges, found from "
    "the weights alone: the larger a weight, the stronger its edge."
)
DEFINITIONS = {
    "positive, negative": "An image whose histograms are the squares of the positive, or negative, weights of a "
    "template. If gradients are unsigned, bright and dark are a guess: the negative image has the same histograms.",
    "distance": "‖φ(x) − d‖ / ‖d‖, d the descriptor of these histograms and φ(x) that of the image x.",
}


@dataclass(frozen=True, eq=False)
class InvertedTemplate:
    """A template, and images of what it looks for.

    Attributes:
        path: of its file, as the user gave it.
        template: the weights.
        images: by the keys of :data:`SIGNS`.
    """

    path: str
    template: DetectorTemplate
    images: Mapping[str, Reconstruction]

    @property
    def name(self) -> str:
        """The name of the file without its folders, printable, and that of the template in it."""
        file = os.fsencode(Path(self.path).name).decode(errors="backslashreplace")
        return f"{file}, {self.template.name}" if self.template.name else file

    def figures(self) -> dict[str, object]:
        """For a table."""
        return {
            "descriptor": self.template.spec.name,
            "shape": "x".join(map(str, self.template.weights.shape)),
            **{f"distance,\n{sign}": float(image.distance[0]) for sign, image in self.images.items()},
        }

    def panels(self) -> list[Panel]:
        """For each sign, the weights as glyphs and the image."""
        panels = []
        for sign, image in self.images.items():
            weights = self.template.weights.numpy() * (-1 if sign == "negative" else 1)
            drawn = glyphs(np.maximum(weights, 0), self.template.spec)
            caption = f"{self.template.name}, {sign} weights" if self.template.name else f"{sign} weights"
            strokes = f"Strokes along the edges that speak {SIGNS[sign]} a detection by {self.name}, cell by cell"
            seen = f"An image with the edges that speak {SIGNS[sign]} a detection by {self.name}"
            panels += [Panel(drawn, caption, strokes), Panel(image.image[0], "what they see", seen)]
            if not self.template.spec.signed:
                negative = "The negative of that image, which has the same edges"
                panels.append(Panel(1 - image.image[0], "or its negative", negative))
        return panels


def page(results: Sequence[InvertedTemplate], skipped: Sequence[Skipped], seed: int) -> str:
    """The page: for each of the first templates a section with its pictures, below a table of all.

    Args:
        results: at least one, in the order to show.
        skipped: inputs without a result.
        seed: of the run.
    """
    shown = results[:SHOWN]
    more = f" The pictures of {len(shown)} of {len(results)} are below." if len(shown) < len(results) else ""
    return html.page(
        "What detectors look for",
        f"{LEAD}{more}",
        [{"template": each.name, **each.figures()} for each in results],
        [*map(_section, shown), skipped_section(skipped)],
        DEFINITIONS,
        html.made(f", seed {seed}"),
    )


def _section(result: InvertedTemplate) -> html.Section:
    template = result.template
    numbers, (height, width) = " x ".join(map(str, template.weights.shape)), template.image_size
    return html.Section(
        f"{result.name}, {template.spec.name}",
        f"{numbers} weights (rows, columns, channels), of windows of {height}x{width} pixels (height x width).",
        result.panels(),
    )
