"""``nablahog dialects``: the HOGs of libraries on a photograph, compared."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path

import torch
from torch import Tensor

from ...dialects import Comparison, compare, page, tables
from ...dialects.heatmap import heat_map
from ...io.files import output_folder, write_text
from ...io.images import limit_size, read_image
from ...paper.tables import write_csv
from ..errors import as_user_error, forbid_overwrite
from ..inputs.spec import SpecOptions
from ..terminal import counter, print_definitions, print_table, say, say_page

RESULTS = ("index.html", "dialects.svg", "dialects.csv", "ties.csv")


def dialects(arguments: Namespace) -> None:
    """Compares the dialects of ``arguments.presets`` on a photograph.

    Raises:
        UserError: the photograph is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        specs = {
            name: SpecOptions(preset, cell=arguments.cell, settings=settings).spec()
            for name, (preset, settings) in arguments.presets.items()
        }
        photograph = read_image(arguments.photo)
    small = limit_size(photograph, arguments.size) if arguments.size else photograph
    # 8-bit levels as in a file: ties need equal levels
    image = (small * 255).round().to(torch.uint8)
    folder = None if arguments.output is None else Path(arguments.output)
    if folder is not None:
        forbid_overwrite([arguments.photo], [folder / name for name in RESULTS])
    with counter("nablahog dialects") as progress, as_user_error(f"{arguments.photo}: "):
        comparison = compare(image, specs, progress)
    shrunk = small.shape != photograph.shape
    introduction = page.lead(comparison, Path(arguments.photo).name, (image.shape[1], image.shape[2]), shrunk)
    if folder is not None:
        _write(folder, comparison, image, introduction)
    if arguments.json:
        report = {"photograph": arguments.photo, "image_size": list(image.shape[1:]), **tables.figures(comparison)}
        print(json.dumps(report, indent=2, allow_nan=False))
        return
    _print(comparison, introduction)
    if folder is None:
        print_definitions(tables.DEFINITIONS)
    else:
        say_page(folder / "index.html")


def _write(folder: Path, comparison: Comparison, image: Tensor, introduction: str) -> None:
    names = comparison.by_likeness()
    drawing = heat_map(comparison.matrix(names), names)
    html = page.page(comparison, image, introduction, drawing)
    with output_folder(folder):
        write_text(folder / "dialects.svg", drawing.svg())
        write_csv(folder / "dialects.csv", tables.csv_rows(comparison))
        write_csv(folder / "ties.csv", tables.csv_ties(comparison.ties))
        write_text(folder / "index.html", html)


def _print(comparison: Comparison, introduction: str) -> None:
    say(introduction)
    for sentence in tables.same(comparison):
        say(sentence)
    if len(comparison.specs) > 2:
        print_table(tables.matrix(comparison))
    print_table(tables.pairs(comparison))
    of_channels = tables.channels(comparison)
    if of_channels:
        say("Channels with the same meaning, compared as they are:")
        print_table(of_channels)
    say("Ties, of the gradients that are not 0:")
    print_table(tables.tie_rows(comparison.ties))
