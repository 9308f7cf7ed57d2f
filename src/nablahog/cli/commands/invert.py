"""``nablahog invert``, images of descriptors, and ``nablahog invert-template``, images of the weights of detectors."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from ...evaluate.learned import load
from ...invert import LearnedPrior, Reconstruction, Search, reconstruct
from ...invert.template import template_descriptor
from ...io.files import distinct_stems, output_folder, write_text
from ...io.images import write_image
from ...viz.pictures import Panel, contact_sheet, glyphs
from ..errors import UserError, as_user_error, forbid_overwrite
from ..inputs.sources import ArrayOptions, Source, read_sources
from ..inputs.spec import SpecOptions
from ..inputs.templates import DetectorTemplate, read_templates
from ..results.inversion import Inversion, batches, invert_batch, print_figures, result_names
from ..terminal import print_definitions, print_table, progress_bars, say

SIGNS = ("positive", "negative")
DEFINITIONS = {
    "positive, negative": "An image whose histograms are the squares of the positive, or negative, weights of a "
    "template. If gradients are unsigned, bright and dark are a guess.",
    "distance": "‖φ(x) − d‖ / ‖d‖, d the descriptor of these histograms and φ(x) that of the image x.",
}


def invert(arguments: Namespace) -> None:
    """Finds an image for each descriptor, in batches of one spec and size.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    sources = read_sources(arguments, keep_photos=True)
    prior = _prior(arguments, sources)
    folder = Path(arguments.output)
    forbid_overwrite(arguments.inputs, [folder / name for source in sources for name in result_names(source)])
    inversions: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress, as_user_error(f"{', '.join(sources[i].path for i in batch)}: "):
                results = invert_batch(
                    [sources[i] for i in batch],
                    device=torch.device(arguments.device),
                    quality=arguments.quality,
                    seed=arguments.seed,
                    max_evaluations=arguments.max_evaluations,
                    prior=prior,
                    colour=arguments.colour,
                    progress=progress(about),
                )
            for index, inversion in zip(batch, results, strict=True):
                inversion.write(folder)
                inversions[index] = inversion
            # after each batch, so that an interrupted run leaves its finished part whole
            figures = [inversions[index].figures() for index in sorted(inversions)]
            write_text(folder / "results.json", json.dumps(figures, indent=2, allow_nan=False) + "\n")
    if arguments.json:
        print(json.dumps(figures, indent=2, allow_nan=False))
    else:
        print_figures([inversions[index] for index in sorted(inversions)])
        say(f"Results in {folder}")


def _prior(arguments: Namespace, sources: Sequence[Source]) -> LearnedPrior | None:
    """The prior of the option ``--prior``, which must have been learned for the specs of all sources."""
    if arguments.prior is None:
        return None
    if arguments.colour:
        raise UserError("--colour and --prior exclude each other: the prior was learned from gray images")
    with as_user_error():
        prior: LearnedPrior = load("prior", Path(arguments.prior))
    for source in sources:
        with as_user_error(f"{source.path}: "):
            prior.check(source.spec)
    return prior


def invert_template(arguments: Namespace) -> None:
    """Makes the pictures: for each template its weights as glyphs, and an image, of either sign.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        wanted, raw = SpecOptions.of(arguments), ArrayOptions.of(arguments)
        files = [(path, read_templates(path, wanted, raw)) for path in arguments.inputs]
    folder = Path(arguments.output)
    stems = distinct_stems([Path(path) for path, _ in files])
    names = [_names(stem, templates) for stem, (_, templates) in zip(stems, files, strict=True)]
    forbid_overwrite(arguments.inputs, [folder / name for of_file in names for name in of_file])
    rows = []
    with output_folder(folder), progress_bars() as progress:
        for stem, (path, templates) in zip(stems, files, strict=True):
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
