"""The arguments of ``nablahog hog``, ``glyph``, ``invert``, ``invert-template`` and ``demo``."""

from __future__ import annotations

import argparse
from typing import get_args

from ...invert.options import InversionMethod, QualityName
from . import options
from .options import SEVERAL, Parser

MOST_SAMPLES = 64


def hog(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog hog``."""
    command = commands.add_parser(
        "hog",
        help="compute the descriptors of photographs",
        description="Computes the HOG descriptor of each photograph and saves it with its spec; with -o NAME.parquet, "
        "those of any number of photographs as one data set, in all processes or on a cluster, resumed when repeated.",
    )
    command.add_argument(
        "inputs",
        nargs="+",
        type=options.path,
        metavar="PHOTO",
        help=f"an image of any format that Pillow reads; {SEVERAL}; for a data set also a URL or pattern of fsspec, "
        "such as s3://bucket/*.jpg, and @FILE with one of these a line",
    )
    text = "descriptor file (.npz) of one photograph, - for stdout; of several, a folder for one file each"
    data = "; or a data set, NAME.parquet, also a URL"
    options.output(command, "FILE", text + data, stdout=True)
    options.common(command)
    options.number(command, "--shard", "images of each file of a data set (default: 1000)")
    options.workers(command)
    options.cluster(command)


def glyph(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog glyph``."""
    command = commands.add_parser(
        "glyph",
        help="draw descriptors",
        description="Draws each descriptor as glyphs: in each cell, strokes along its edges.",
    )
    options.inputs(command)
    text = "PNG file for one input, - for stdout; any other name is a folder for one file each"
    options.output(command, "FILE", text, stdout=True)
    options.common(command)
    options.memory(command)


def invert(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog invert``."""
    command = commands.add_parser(
        "invert",
        help="find images that have given descriptors",
        description="Finds an image for each descriptor and compares it with the photograph if there is one. "
        "Writes <stem>_preimage.png, _glyphs.png, _thumbnails.png, the page index.html and results.json, which also "
        "says which inputs were skipped, and why.",
    )
    options.inputs(command, "; a data set of `nablahog hog -o NAME.parquet`, also a URL")
    options.output(command, "DIR", "folder for the results, made if missing")
    options.common(command)
    options.memory(command)
    options.minimiser(command)
    options.cluster(command)
    command.add_argument(
        "--method",
        choices=get_args(InversionMethod),
        default="default",
        help="paper searches as the paper does, from noise over gray values by Powell's dogleg, in some twenty times "
        "the time (default: default)",
    )
    command.add_argument(
        "--iterations",
        action="store_true",
        help="with --method paper: write <stem>_iterations.png, too, the image after 0, 1, 2 and all iterations",
    )
    command.add_argument(
        "--quality",
        choices=get_args(QualityName),
        default="best",
        help="fast finds coarser images in about a sixth of the time (default: best)",
    )
    options.prior(command)
    options.number(
        command,
        "--samples",
        "of unsigned descriptors, write <stem>_samples.png, too: so many further answers that the prior thinks "
        "possible, in so many times the time; where they differ, the descriptor does not tell",
        least=2,
        most=MOST_SAMPLES,
    )
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
        "<stem>_positive.png, <stem>_negative.png and, with glyphs, <stem>_templates.png, and a page, index.html.",
    )
    command.add_argument(
        "inputs",
        nargs="+",
        type=options.path,
        metavar="FILE",
        help="a model of voc-release5 (.mat), or an array of weights (.npy, .npz, .mat), with or without a bias at its "
        "end; an array needs --preset, except for OpenCV's people detectors",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.of_arrays(command)
    options.dialect(command, "type of descriptor that an array is for")
    options.device_option(command)
    options.memory(command)
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
