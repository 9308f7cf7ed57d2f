"""The arguments of ``nablahog hog``, ``glyph``, ``invert`` and ``demo``."""

from __future__ import annotations

import argparse
from typing import get_args

from ...invert.choices import InversionMethod, QualityName
from . import options
from .options import SEVERAL, Parser

MOST_SAMPLES = 64


def hog(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "hog",
        usage="%(prog)s PHOTO … -o FILE [options]",
        help="compute the descriptors of photographs",
        description="Computes the HOG descriptor of each photograph and saves it with its spec; with -o NAME.parquet, "
        "any number of photographs becomes one data set, in parallel; the same command resumes it.",
    )
    command.add_argument(
        "inputs",
        nargs="+",
        type=options.path,
        metavar="PHOTO",
        help=f"an image of any format that Pillow reads; {SEVERAL}; for a data set also a URL or pattern of fsspec, "
        "such as s3://bucket/*.jpg, and @FILE, a list with one of these per line",
    )
    options.output(
        command,
        "FILE",
        "descriptor file (.npz) of one photograph, - for stdout; a folder for several; or a data set, NAME.parquet",
        stdout=True,
    )
    options.preset(command)
    options.size(command)
    options.workers(command)
    options.cluster(command)


def glyph(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "glyph",
        usage="%(prog)s INPUT … -o FILE [options]",
        help="draw descriptors",
        description="Draws each descriptor as glyphs: in each cell, strokes along its edges.",
    )
    options.inputs(command)
    options.output(command, "FILE", "PNG file of one input, - for stdout; a folder for several", stdout=True)
    options.preset(command)
    options.size(command)


def invert(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "invert",
        usage="%(prog)s INPUT … -o DIR [options]",
        help="find images that have given descriptors, or see what a detector looks for",
        description="Finds an image for each descriptor and compares it with the photograph, if there is one. Writes "
        "pictures, results.json and the page index.html.",
    )
    options.inputs(command, "; a data set NAME.parquet")
    options.output(command, "DIR", "folder for the results, made if missing")
    options.preset(command)
    options.size(command)
    command.add_argument(
        "--template",
        action="store_true",
        help="inputs are the weights of linear detectors, in arrays, DPM models (.mat) or files that OpenCV's "
        "HOGDescriptor saved (.yml, .xml, .json): show what they look for",
    )
    options.choice(command, "--quality", get_args(QualityName), "best, or fast: coarser, with fewer evaluations")
    method = "how to search: default, or paper, the paper's own, which is much slower"
    options.choice(command, "--method", get_args(InversionMethod), method)
    prior = "a file of `nablahog learn prior`, or none for no prior (default: the prior that comes with nablahog)"
    options.file(command, "--prior", "FILE", prior)
    options.number(
        command,
        "--samples",
        "show N other images for an unsigned descriptor: they differ where it leaves the image open",
        least=2,
        most=MOST_SAMPLES,
    )
    command.add_argument("--device", type=options.device, default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    options.cluster(command)
    options.seed(command)


def demo(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.seed(command)
