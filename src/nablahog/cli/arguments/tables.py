"""The arguments of ``nablahog table1`` and ``nablahog table2``."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping

from ...paper.names import AS_PUBLISHED, CONDITIONS, DIALECTS, LEARNED_DIALECTS, PRIORS, TABLE1, TABLE2
from . import options
from .learn import KINDS
from .options import Parser

TABLE1_SIZE = 128  # that of the paper's images
SCENES = 200  # of Table 2
HARDER = 20  # objects in each of its conditions
LEARNED = (*(name for name in TABLE1 if name in KINDS), *PRIORS)
"""The kinds of files that methods of Table 1 learn."""


def table1(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog table1``."""
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
    options.number(command, "--limit", "only the first N images")
    options.size(command, TABLE1_SIZE)
    options.number(command, "--max-evaluations", "of the objective, for each image; fewer is faster", least=2)
    command.add_argument(
        "--learned",
        action="append",
        type=_learned,
        metavar="KIND=FILE",
        help=f"a file that `nablahog learn` wrote: {', '.join(LEARNED)}; may be repeated (default: the priors that "
        "come with nablahog; others are learned once from the photographs of scikit-image)",
    )


def table2(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog table2``."""
    command = commands.add_parser(
        "table2",
        usage="%(prog)s [CSV] -o DIR [options]",
        help="compare all methods on objects of known pose",
        description="Finds the poses of many objects by all methods of the paper's Table 2 and writes the table: the "
        "page index.html, files of CSV and results.json. The objects are rendered chairs, those of PASCAL3D+, or "
        "yours. A second table has fewer of them under harder conditions. An interrupted run is resumed when it is "
        "repeated.",
    )
    command.add_argument(
        "annotations",
        nargs="?",
        type=options.path,
        metavar="CSV",
        help="objects in photographs of your own, one a line: columns image (relative to the file's folder), x0, y0, "
        "x1, y1 in pixels, azimuth, elevation, theta in degrees, and model if known (default: scenes)",
    )
    _table(command, TABLE2, {})
    options.number(command, "--objects", f"how many (default: {SCENES} scenes, or all photographs)")
    options.file(command, "--models", "DIR", "folder of CAD models (default: procedural chairs)")
    command.add_argument("--unknown-model", action="store_true", help="search among all models except the object's own")
    command.add_argument(
        "--conditions",
        type=options.chosen("conditions", CONDITIONS, {"none": (), "all": CONDITIONS}),
        metavar="NAME,…",
        help=f"of the second table: none, all (default), or some of {', '.join(CONDITIONS)}",
    )
    options.file(
        command, "--viewpoints", "CSV", "viewpoints of the scenes: columns azimuth, elevation, and theta if known"
    )
    command.add_argument(
        "--pascal3d",
        nargs=2,
        type=options.path,
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
        raise argparse.ArgumentTypeError(f"expected KIND=FILE with a kind of {', '.join(LEARNED)}, got {text!r}")
    return kind, options.path(file)
