"""``nablahog invert-template``: images of the weights of detectors."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from ...invert import Reconstruction, Search, reconstruct
from ...invert.template import template_descriptor
from ...io.files import distinct_stems, output_folder
from ...io.images import write_image
from ...viz.pictures import Panel, contact_sheet, glyphs
from ..errors import as_user_error, forbid_overwrite
from ..inputs.arrays import ArrayOptions
from ..inputs.expand import expand
from ..inputs.memory import check_glyphs, check_inversion
from ..inputs.spec import SpecOptions
from ..inputs.templates import DetectorTemplate, read_templates
from ..terminal import print_definitions, print_table, progress_bars, say

SIGNS = ("positive", "negative")
DEFINITIONS = {
    "positive, negative": "An image whose histograms are the squares of the positive, or negative, weights of a "
    "template. If gradients are unsigned, bright and dark are a guess.",
    "distance": "‖φ(x) − d‖ / ‖d‖, d the descriptor of these histograms and φ(x) that of the image x.",
}


def invert_template(arguments: Namespace) -> int:
    """Makes the pictures: for each template its weights as glyphs, and an image, of either sign; returns the status.

    Raises:
        UserError: no input can be used, or an option is wrong.
        OSError: a folder is missing or cannot be written.
    """
    with as_user_error():
        wanted, raw = SpecOptions.of(arguments), ArrayOptions.of(arguments)
    expanded = expand(arguments, (".mat", ".npy", ".npz"))
    skipping, folder = expanded.skipping, Path(arguments.output)
    stems = distinct_stems([Path(path) for path in expanded.paths])
    files: list[tuple[str, str, list[DetectorTemplate]]] = []
    for stem, path in zip(stems, expanded.paths, strict=True):
        with skipping.each(path):
            templates = read_templates(path, wanted, raw)
            for each in templates:
                check_inversion(path, each.image_size, each.weights.numel(), arguments.memory)
                check_glyphs(path, tuple(each.weights.shape), each.spec, arguments.memory)
            files.append((stem, path, templates))
    skipping.check()
    names = [_names(stem, templates) for stem, _, templates in files]
    forbid_overwrite(expanded.paths, [folder / name for of_file in names for name in of_file])
    rows = []
    with output_folder(folder), progress_bars() as progress:
        for stem, path, templates in files:
            sheet = []
            for number, template in enumerate(templates):
                with as_user_error(f"{path}: "):
                    bars = {sign: progress(f"{stem} {template.name} {sign}") for sign in SIGNS}
                    results = {sign: _invert_sign(template, sign, arguments, bar) for sign, bar in bars.items()}
                for sign, result in results.items():
                    write_image(folder / _name(stem, template, number, sign), result.image[0])
                sheet.append(_panels(template, results))
                rows.append(_row(path, template, results))
            write_image(folder / f"{stem}_templates.png", contact_sheet(sheet))
    print_table(rows)
    print_definitions(DEFINITIONS)
    say(f"Results in {folder}")
    return skipping.status


def _invert_sign(
    template: DetectorTemplate, sign: str, arguments: Namespace, progress: Callable[[int, int], None]
) -> Reconstruction:
    weights = template.weights[None].to(torch.device(arguments.device))
    descriptor = template_descriptor(weights, template.spec, template.image_size, negative=sign == "negative")
    return reconstruct(
        descriptor,
        template.spec,
        template.image_size,
        seed=arguments.seed,
        search=Search(max_evaluations=arguments.max_evaluations),
        progress=progress,
    )


def _panels(template: DetectorTemplate, results: Mapping[str, Reconstruction]) -> list[Panel]:
    panels = []
    for sign, result in results.items():
        weights = template.weights.numpy() * (-1 if sign == "negative" else 1)
        caption = f"{template.name}, {sign} weights" if template.name else f"{sign} weights"
        seen = Panel(result.image[0], "what they see")
        panels += [Panel(glyphs(np.maximum(weights, 0), template.spec), caption), seen]
    return panels


def _row(path: str, template: DetectorTemplate, results: Mapping[str, Reconstruction]) -> dict[str, object]:
    rows, cols, channels = template.weights.shape
    return {
        "input": path,
        "template": template.name,
        "descriptor": template.spec.name,
        "shape": f"{rows}x{cols}x{channels}",
        **{f"distance,\n{sign}": float(result.distance[0]) for sign, result in results.items()},
    }


def _names(stem: str, templates: Sequence[DetectorTemplate]) -> list[str]:
    """The names of all files of an input."""
    pictures = [_name(stem, template, k, sign) for k, template in enumerate(templates) for sign in SIGNS]
    return [*pictures, f"{stem}_templates.png"]


def _name(stem: str, template: DetectorTemplate, number: int, sign: str) -> str:
    return f"{stem}_{number + 1}_{sign}.png" if template.name else f"{stem}_{sign}.png"
