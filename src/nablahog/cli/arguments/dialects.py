"""The arguments of ``nablahog dialects``."""

from __future__ import annotations

import argparse

from . import options
from .did_you_mean import did_you_mean
from .options import SIZE, Parser, setting
from .preset_parameters import PRESETS

CELL = (8, 8)
Parameters = tuple[tuple[str, str], ...]


def _presets(text: str) -> dict[str, tuple[str, Parameters]]:
    """Parses PRESET,PRESET:KEY=VALUE:… to presets and their parameters, by these texts."""
    presets: dict[str, tuple[str, Parameters]] = {}
    for name in text.split(","):
        preset, *parameters = name.split(":")
        if preset not in PRESETS:
            meant = did_you_mean(preset, PRESETS)
            raise argparse.ArgumentTypeError(f"expected presets of {', '.join(PRESETS)}, got {preset!r}{meant}")
        if name in presets:
            raise argparse.ArgumentTypeError(f"expected different presets, got {name} twice")
        presets[name] = preset, tuple(setting(each) for each in parameters)
    if len(presets) < 2:
        raise argparse.ArgumentTypeError(f"expected at least two presets, separated by commas, got {text!r}")
    return presets


def dialects(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog dialects``."""
    command = commands.add_parser(
        "dialects",
        help="compare the HOGs of libraries on a photograph",
        description="Measures the distances between the HOGs of libraries on a photograph, and the share of each "
        "convention: ties, border, colour rule, bins, votes, cells, normaliser and so on. With -o, writes "
        "the page index.html, dialects.svg, dialects.csv and ties.csv.",
    )
    command.add_argument("photo", type=options.path, metavar="PHOTO", help="an image of any format that Pillow reads")
    options.output(command, "DIR", "folder for the results, made if missing", required=False)
    command.add_argument(
        "--presets",
        type=_presets,
        metavar="A,B,…",
        default=",".join(PRESETS),
        help="at least two, each PRESET or PRESET:KEY=VALUE with parameters as of --set, as opencv:gamma=false "
        f"(default: {','.join(PRESETS)})",
    )
    command.add_argument(
        "--cell",
        type=options.cell,
        default=CELL,
        metavar="N|HxW",
        help=f"pixels of a cell of all, one number or height x width (default: {CELL[0]})",
    )
    options.size(command, SIZE)
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of tables")
