"""The arguments of ``nablahog table1``, ``table2`` and ``learn``."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping

from ...paper.names import AS_PUBLISHED, CONDITIONS, DIALECTS, LEARNED_DIALECTS, PRIORS, TABLE1, TABLE2
from ...requests.dialect import DEFAULT_PRESET, Dialect
from ...requests.inversion import HogRequest
from ...requests.kinds import choice, integer, path, read_path
from . import options
from .options import Parser

BOVW_SIZE = 128  # that of the images of Table 1
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
    "photographs and their scales: the background from which the elements of an object stand out.",
    "hoggles": "Learns a dictionary of windows of descriptors together with one of their gray patches, as Vondrick et "
    "al. do. This takes about half an hour on one core.",
    "bovw": "Learns visual words, their gray patches and their arrangements from images of one size, which is the size "
    "of the images that can be reconstructed.",
}
_OUTPUTS = {"prior": "the prior", "background": "the background", "hoggles": "the dictionaries", "bovw": "the words"}
TABLE1_SIZE = 128  # that of the paper's images
SCENES = 200  # of Table 2
HARDER = 20  # objects in each of its conditions
LEARNED = (*(name for name in TABLE1 if name in KINDS), *PRIORS)
"""The kinds of files that methods of Table 1 learn."""


def learn(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog learn`` and all its kinds."""
    command = commands.add_parser(
        "learn",
        help="learn from photographs",
        description="Learns from photographs what helps to invert descriptors or to find poses.",
    )
    kinds = command.add_subparsers(metavar="WHAT", required=True, parser_class=Parser)
    for kind in KINDS:
        parser = kinds.add_parser(kind, help=_HELP[kind], description=_DESCRIPTIONS[kind])
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
        help=f"a file that `nablahog learn` wrote: {', '.join(LEARNED)}; may be repeated (default: the priors that "
        "come with nablahog; others are learned once from the photographs of scikit-image)",
    )


def table2(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "table2",
        usage="%(prog)s [CSV] -o DIR [options]",
        help="compare all methods on objects of known pose",
        description="Finds the poses of many objects by all methods of the paper's Table 2 and writes the table: the "
        "page index.html, summary.csv and other files. The objects are rendered chairs, those of PASCAL3D+, or "
        "yours. A second table has fewer objects, under harder conditions. An interrupted run is resumed when it is "
        "repeated.",
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
        help=f"conditions of the second table: none, all (default), or some of {', '.join(CONDITIONS)}",
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
    if kind not in LEARNED or not equals:
        raise ValueError(f"expected KIND=FILE with a kind of {', '.join(LEARNED)}, got {text!r}")
    return kind, read_path(file)
