"""The arguments of ``nablahog hog``, ``glyph``, ``invert``, ``invert-template``, ``demo`` and ``dialects``."""

from __future__ import annotations

import argparse
from typing import get_args

from ...invert.quality import QualityName
from . import options
from .options import Parser, setting
from .preset_parameters import PRESETS

SIZE = 256
CELL = (8, 8)

Parameters = tuple[tuple[str, str], ...]


def hog(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog hog``."""
    command = commands.add_parser(
        "hog",
        help="compute the descriptors of photographs",
        description="Computes the HOG descriptor of each photograph and saves it with its spec.",
    )
    command.add_argument("inputs", nargs="+", metavar="PHOTO", help="an image of any format that Pillow reads")
    options.output(command, "FILE", "descriptor file (.npz) of one photograph; of several, a folder for one file each")
    options.common(command, 0)


def glyph(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog glyph``."""
    command = commands.add_parser(
        "glyph",
        help="draw descriptors",
        description="Draws each descriptor as glyphs: in each cell, strokes along its edges.",
    )
    options.inputs(command)
    options.output(
        command, "FILE", "PNG file for one input; any name that does not end in .png is a folder for one file each"
    )
    options.common(command, SIZE)


def invert(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog invert``."""
    command = commands.add_parser(
        "invert",
        help="find images that have given descriptors",
        description="Finds an image for each descriptor and compares it with the photograph if there is one. "
        "Writes <stem>_preimage.png, _glyphs.png, _thumbnails.png and results.json.",
    )
    options.inputs(command)
    options.output(command, "DIR", "folder for the results, made if missing")
    options.common(command, SIZE)
    options.minimiser(command)
    command.add_argument(
        "--quality",
        choices=get_args(QualityName),
        default="best",
        help="fast finds coarser images in about a sixth of the time (default: best)",
    )
    options.prior(command, "for descriptors of the spec that it was learned for")
    command.add_argument(
        "--colour",
        action="store_true",
        help="find images in colour, for descriptors of colour images; the hues are a guess: no descriptor fixes them",
    )


def invert_template(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog invert-template``."""
    command = commands.add_parser(
        "invert-template",
        help="show what a linear detector looks for",
        description="Shows what the positive and the negative weights of linear templates see: of DPM models "
        "(voc-release5 .mat), root and parts of each component; of arrays of weights, such as an SVM's. Writes "
        "<stem>_positive.png, <stem>_negative.png and, with glyphs, <stem>_templates.png.",
    )
    command.add_argument(
        "inputs",
        nargs="+",
        metavar="FILE",
        help="a model of voc-release5 (.mat), or an array of weights (.npy, .npz, .mat), with or without a bias at its "
        "end; an array needs --preset, except for OpenCV's people detectors",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.of_arrays(command)
    options.dialect(command, "type of descriptor that an array is for")
    options.device_option(command)
    options.minimiser(command)


def demo(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog demo``."""
    command = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.device_option(command)
    options.minimiser(command)


def _presets(text: str) -> dict[str, tuple[str, Parameters]]:
    """Parses PRESET,PRESET:KEY=VALUE:… to presets and their parameters, by these texts."""
    presets: dict[str, tuple[str, Parameters]] = {}
    for name in text.split(","):
        preset, *parameters = name.split(":")
        if preset not in PRESETS:
            raise argparse.ArgumentTypeError(f"expected presets of {', '.join(PRESETS)}, got {preset!r}")
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
        "the page index.html, dialects.png, dialects.csv and ties.csv.",
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
