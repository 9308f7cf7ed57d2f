"""``nablahog invert --template``: what the weights of detectors look for."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import torch

from ...invert import Reconstruction, reconstruct_template
from ...io.files import distinct_stems, output_folder, write_text
from ...io.images import write_image
from ...viz.pictures import contact_sheet
from ..errors import as_user_error, forbid_overwrite
from ..inputs.arrays import ArrayOptions
from ..inputs.expand import expand
from ..inputs.spec import SpecOptions
from ..inputs.templates import DetectorTemplate, read_templates
from ..results import template_page
from ..results.template_page import SIGNS, InvertedTemplate
from ..terminal import print_table, progress_bars, say_page


def invert_templates(arguments: Namespace) -> int:
    """Draws the positive and the negative weights of each template, and an image that has them; returns the status.

    Raises:
        UserError: no input can be used, or an option is wrong.
        OSError: a folder is missing or cannot be written.
    """
    with as_user_error():
        spec_options, array_options = SpecOptions.of(arguments), ArrayOptions.of(arguments)
    expanded = expand(arguments, (".mat", ".npy", ".npz"))
    skipping, folder = expanded.skipping, Path(arguments.output)
    stems = distinct_stems([Path(path) for path in expanded.paths])
    files: list[tuple[str, str, list[DetectorTemplate]]] = []
    for stem, path in zip(stems, expanded.paths, strict=True):
        with skipping.each(path):
            files.append((stem, path, read_templates(path, spec_options, array_options)))
    skipping.check()
    names = [_names(stem, templates) for stem, _, templates in files]
    forbid_overwrite(expanded.paths, [folder / name for name in (*chain(*names), "index.html")])
    done: list[InvertedTemplate] = []
    with output_folder(folder):
        for stem, path, templates in files:
            of_file = []
            for number, template in enumerate(templates):
                with as_user_error(f"{path}: "):
                    images = {sign: _invert_sign(template, sign, arguments) for sign in SIGNS}
                for sign, image in images.items():
                    write_image(folder / _name(stem, template, number, sign), image.image[0])
                of_file.append(InvertedTemplate(path, template, images))
            write_image(folder / f"{stem}_templates.png", contact_sheet([each.panels() for each in of_file]))
            done += of_file
        write_text(folder / "index.html", template_page.page(done, skipping.skipped, arguments.seed))
    print_table([{"input": each.path, "template": each.template.name, **each.figures()} for each in done])
    say_page(folder / "index.html")
    return skipping.status


def _invert_sign(template: DetectorTemplate, sign: str, arguments: Namespace) -> Reconstruction:
    with progress_bars() as progress:
        return reconstruct_template(
            template.weights[None].to(torch.device(arguments.device)),
            template.spec,
            template.image_size,
            negative=sign == "negative",
            seed=arguments.seed,
            progress=progress(f"{template.name} {sign}".strip()),
        )


def _names(stem: str, templates: Sequence[DetectorTemplate]) -> list[str]:
    """The names of all files of an input."""
    pictures = [_name(stem, template, k, sign) for k, template in enumerate(templates) for sign in SIGNS]
    return [*pictures, f"{stem}_templates.png"]


def _name(stem: str, template: DetectorTemplate, number: int, sign: str) -> str:
    return f"{stem}_{number + 1}_{sign}.png" if template.name else f"{stem}_{sign}.png"
