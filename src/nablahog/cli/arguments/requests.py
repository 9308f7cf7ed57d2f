"""The arguments of ``nablahog hog``, ``glyph``, ``invert``, ``demo`` and ``pose``."""

from __future__ import annotations

import argparse
import re

from ...requests.inversion import GlyphRequest, HogRequest, InvertRequest
from ...requests.kinds import Kind, path, read_path
from ...requests.pose import PoseRequest
from . import options
from .options import SEVERAL, Parser


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
        type=options.typed(read_path),
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
    options.add_request(command, HogRequest)
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
    options.add_request(command, GlyphRequest)


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
    options.add_request(command, InvertRequest)
    options.add(command, "--device", Kind("DEVICE", device), "cpu, cuda or cuda:N", "cpu")
    options.cluster(command)


def demo(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    options.seed(command)


def device(text: str) -> str:
    """An existing device by its name; PyTorch is imported for CUDA only."""
    match = re.fullmatch(r"cpu|cuda(?::(\d{1,3}))?", text)
    if match is None:
        raise ValueError(f"expected cpu, cuda or cuda:N, got {text!r}")
    if text != "cpu":
        import torch

        devices = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if devices == 0:
            raise ValueError(f"expected a CUDA device for {text}, but PyTorch finds none here")
        if int(match[1] or 0) >= devices:
            raise ValueError(f"expected cuda:0 … cuda:{devices - 1}, got {text}")
    return text


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "pose",
        usage="%(prog)s PHOTO -o DIR [options]",
        help="find the pose of objects from CAD models",
        description="Finds the viewpoint of objects in a photograph: the pose at which the HOG of a rendering of a CAD "
        "model is most similar to the photograph's. Writes poses.csv, poses.json and the page index.html.",
    )
    options.add(command, "photo", path("PHOTO"), "an image; with --annotations the folder of images")
    options.output(command, "DIR", "folder for the results, made if missing")
    options.add_request(command, PoseRequest)
    options.workers(command)
