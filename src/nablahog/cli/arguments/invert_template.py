"""The arguments of ``nablahog invert-template``."""

from __future__ import annotations

import argparse

from . import options
from .options import Parser


def invert_template(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog invert-template``."""
    command = commands.add_parser(
        "invert-template",
        help="show what a linear detector looks for",
        description="Shows what the positive and the negative weights of linear templates see: of DPM models "
        "(voc-release5 .mat), root and parts of each component; of arrays of weights, such as an SVM's. Leaves "
        "<stem>_positive.png, <stem>_negative.png and <stem>_templates.png, with glyphs, in the folder.",
    )
    command.add_argument(
        "inputs",
        nargs="+",
        metavar="FILE",
        help="a model of voc-release5 (.mat), or an array of weights (.npy, .npz, .mat), with or without a bias at its "
        "end; it needs --preset, but for OpenCV's people detectors",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.of_arrays(command)
    options.dialect(command, "type of descriptor that an array is for")
    options.device_option(command)
    options.minimiser(command)
