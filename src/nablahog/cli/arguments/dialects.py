"""The arguments of ``nablahog dialects``."""

from __future__ import annotations

import argparse

from . import options
from .options import Parser, setting
from .preset_parameters import PRESETS

SIZE = 256
CELL = (8, 8)

Settings = tuple[tuple[str, str], ...]


def _presets(text: str) -> dict[str, tuple[str, Settings]]:
    """Presets and what is set of their parameters, by the texts that name them: PRESET, or PRESET:KEY=VALUE:…"""
    found: dict[str, tuple[str, Settings]] = {}
    for name in text.split(","):
        preset, *settings = name.split(":")
        if preset not in PRESETS:
            raise argparse.ArgumentTypeError(f"expected presets of {', '.join(PRESETS)}, got {preset!r}")
        if name in found:
            raise argparse.ArgumentTypeError(f"expected different presets, got {name} twice")
        found[name] = preset, tuple(setting(each) for each in settings)
    if len(found) < 2:
        raise argparse.ArgumentTypeError(f"expected at least two presets, separated by commas, got {text!r}")
    return found


def dialects(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog dialects``."""
    command = commands.add_parser(
        "dialects",
        help="compare the HOGs of libraries on a photograph",
        description="Measures how far apart the HOGs of libraries are on a photograph, and how much of that each of "
        "their conventions is: ties, border, colour rule, bins, votes, cells, normaliser and so on. With -o, leaves "
        "index.html to look at, dialects.png, dialects.csv and ties.csv.",
    )
    command.add_argument("photo", metavar="PHOTO", help="an image of any format that Pillow reads")
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results, made if missing")
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
