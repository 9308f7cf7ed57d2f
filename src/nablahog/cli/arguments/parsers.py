"""The arguments of the commands."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection, Mapping

from ...paper.names import AS_PUBLISHED, CONDITIONS, DIALECTS, LEARNED_DIALECTS, PRIORS, TABLE1, TABLE2
from ...requests.dialect import DEFAULT_PRESET, Dialect
from ...requests.inversion import GlyphRequest, HogRequest, InvertRequest
from ...requests.options import Kind, choice, integer, path, read_path
from ...requests.pose import PoseRequest
from . import options
from .options import SEVERAL, Parser

BOVW_SIZE = 128  # that of the images of Table 1
TRAINING_SIZE = 512  # pixels on the longer side that the photographs of other kinds are shrunk to
KINDS = ("prior", "background", "hoggles", "bovw")
"""What ``nablahog learn`` learns from photographs."""

_HELP = {
    "prior": "the images to expect for a descriptor, for `nablahog invert --prior`",
    "background": "mean and covariance of descriptors, for estimate_pose(background=…)",
    "hoggles": "the paired dictionaries of HOGgles, for Table 1",
    "bovw": "visual words and their arrangements, for Table 1",
}
_DESCRIPTIONS = {
    "prior": "Trains a network to predict an image from its descriptor: near the mean of all photographs that have it. "
    "Runs on a GPU if there is one. The state after each epoch is saved in FILE.npz.checkpoint; an interrupted run is "
    "resumed from it when it is repeated, and it is removed at the end.",
    "background": "Learns the mean of a descriptor and the covariance of its cells at each offset, over all "
    "photographs and their scales: the background from which the elements of an object stand out. The state after "
    "every ten photographs is saved in FILE.npz.checkpoint, as for a prior.",
    "hoggles": "Learns a dictionary of windows of descriptors together with one of their gray patches, as Vondrick et "
    "al. do. This takes about half an hour on one core. The state is saved in FILE.npz.checkpoint every 20 of 1000 "
    "iterations; an interrupted run is resumed from it when it is repeated, and it is removed at the end.",
    "bovw": "Learns visual words, their gray patches and their arrangements from images of one size, which is the size "
    "of the images that can be reconstructed. The state after each round of k-means is saved in FILE.npz.checkpoint, "
    "as for a prior.",
}
_OUTPUTS = {"prior": "the prior", "background": "the background", "hoggles": "the dictionaries", "bovw": "the words"}
TABLE1_SIZE = 128  # that of the paper's images
SCENES = 200  # of Table 2
HARDER = 20  # objects in each of its conditions
LEARNED_NAMES = (*(name for name in TABLE1 if name in KINDS), *PRIORS)
"""The kinds of files that methods of Table 1 learn."""


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
        help=f"an image (JPEG, PNG, TIFF, WebP and others); {SEVERAL}; for a data set also a URL or pattern of fsspec, "
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
    options.add(command, "--device", Kind("DEVICE", lambda _, text: device(text)), "cpu, cuda or cuda:N", "cpu")
    options.cluster(command)


def demo(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    options.output(command, "DIR", "folder for the results, made if missing")


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


def learn(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog learn`` and all its kinds."""
    command = commands.add_parser(
        "learn",
        help="learn from photographs",
        description="Learns from photographs what helps to invert descriptors or to find poses.",
    )
    kinds = command.add_subparsers(metavar="WHAT", required=True, parser_class=Parser)
    for kind in KINDS:
        size = "" if kind == "bovw" else f" Shrinks photographs to {TRAINING_SIZE} pixels on the longer side."
        parser = kinds.add_parser(kind, help=_HELP[kind], description=_DESCRIPTIONS[kind] + size)
        options.output(parser, "FILE.npz", _OUTPUTS[kind])
        options.images(parser)
        if kind == "prior":
            _prior(parser)
        if kind in ("background", "hoggles"):
            options.add_field(parser, Dialect, "preset", "aubry" if kind == "background" else DEFAULT_PRESET)
            options.add_field(parser, Dialect, "settings")
        if kind == "bovw":
            options.add_field(parser, HogRequest, "size", BOVW_SIZE)
        if kind in ("background", "bovw"):
            options.cluster(parser)
        if kind in ("hoggles", "bovw"):
            options.seed(parser)
        parser.set_defaults(command=f"learn {kind}", kind=kind)


def _prior(command: argparse.ArgumentParser) -> None:
    signs = "for all descriptors of signed gradients, such as uoctti, or of unsigned ones, such as paper"
    options.add(command, "--signs", choice(("signed", "unsigned")), signs, "signed")
    start = "continue the training of this prior; 'default' is the one that comes with nablahog"
    options.add(command, "--start", path("FILE"), start)
    epochs = "passes over the images (default: as many as take an hour or two on two cores)"
    options.add(command, "--epochs", integer(), epochs)


def table1(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "table1",
        usage="%(prog)s -o DIR [options]",
        help="compare all methods on a folder of images",
        description="Inverts the descriptors of all images by all methods of the paper's Table 1 and writes the table: "
        "the page index.html, summary.csv, per_image.csv, times.csv and failures.csv. An interrupted run is "
        "resumed when it is repeated.",
    )
    options.images(command)
    _table(command, TABLE1, {"dialects": DIALECTS, "dialects-learned": LEARNED_DIALECTS, "published": AS_PUBLISHED})
    options.add(command, "--limit", integer(), "only the first N images")
    options.add_field(command, HogRequest, "size", TABLE1_SIZE)
    most = "at most N evaluations of the objective for each image; fewer are faster"
    options.add(command, "--max-evaluations", integer(2), most)
    command.add_argument(
        "--learned",
        action="append",
        type=options.typed(_learned),
        metavar="KIND=FILE",
        help=f"a file that `nablahog learn` wrote: {', '.join(LEARNED_NAMES)}; may be repeated (default: the priors "
        "that come with nablahog; others are learned once from the photographs of scikit-image)",
    )


def table2(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "table2",
        usage="%(prog)s [CSV] -o DIR [options]",
        help="compare all methods on objects of known pose",
        description="Finds the poses of many objects by all methods of the paper's Table 2 and writes the table: the "
        "page index.html, summary.csv and other files. The objects are rendered chairs, those of PASCAL3D+, or "
        "yours. A second table has fewer objects, under harder conditions (of your own photographs if asked for). An "
        "interrupted run is resumed when it is repeated.",
    )
    command.add_argument(
        "annotations",
        nargs="?",
        type=options.typed(read_path),
        metavar="CSV",
        help="objects in your own photographs, one per line: columns image (relative to the file's folder), x0, y0, "
        "x1, y1 in pixels, azimuth, elevation, theta in degrees, and model if known (default: scenes)",
    )
    _table(command, TABLE2, {})
    number = f"number of objects (default: {SCENES} scenes, or all photographs)"
    options.add(command, "--objects", integer(), number)
    options.add(command, "--models", path("DIR"), "folder of CAD models (default: procedural chairs)")
    command.add_argument("--unknown-model", action="store_true", help="search among all models except the object's own")
    command.add_argument(
        "--conditions",
        type=options.chosen("conditions", CONDITIONS, {"none": (), "all": CONDITIONS}),
        metavar="NAME,…",
        help=f"conditions of the second table: none, all, or some of {', '.join(CONDITIONS)} (default: all for scenes, "
        "none for photographs)",
    )
    viewpoints = "viewpoints of the scenes: columns azimuth, elevation, and theta if known"
    options.add(command, "--viewpoints", path("CSV"), viewpoints)
    command.add_argument(
        "--pascal3d",
        nargs=2,
        type=options.typed(read_path),
        metavar=("VOC2012", "PASCAL3D"),
        help="the chairs of PASCAL3D+: the folders VOC2012 and PASCAL3D+_release1.1",
    )


def _table(command: argparse.ArgumentParser, methods: Collection[str], sets: Mapping[str, Collection[str]]) -> None:
    """Adds what both tables take; ``sets`` are names that stand for several of the ``methods``."""
    options.output(command, "DIR", "folder for the results, made if missing")
    inside = {name for names in sets.values() for name in names}
    command.add_argument(
        "--methods",
        type=options.chosen("methods", methods, sets),
        metavar="NAME,…",
        help=f"only these: {', '.join([name for name in methods if name not in inside] + list(sets))}",
    )
    options.workers(command)
    options.cluster(command)
    options.seed(command)


def _learned(text: str) -> tuple[str, str]:
    kind, equals, file = text.partition("=")
    if kind not in LEARNED_NAMES or not equals:
        raise ValueError(f"expected KIND=FILE with a kind of {', '.join(LEARNED_NAMES)}, got {text!r}")
    return kind, read_path(file)
