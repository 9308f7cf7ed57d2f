"""The arguments of ``nablahog table1`` and ``nablahog table2``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from ...evaluate.names import AS_PUBLISHED, DIALECTS, LEARNED_DIALECTS, SHIPPED, TABLE1, TABLE2, TAKES_HOURS
from . import options
from .learn import KINDS
from .options import Parser

TABLE1_SIZE = 128  # that of the paper's images
SCENES = 200  # of Table 2


def _table1_methods() -> Iterator[str]:
    """A line for each method of Table 1: its name, its input, and when it runs."""
    from ...evaluate.methods import METHODS  # loads PyTorch

    for name, method in METHODS.items():
        when = "with --methods only" if method.asked else "runs"
        for kind in set(method.needs) - set(SHIPPED):
            when = f"with --{kind} FILE only" if kind in TAKES_HOURS else f"runs; learns {kind} the first time"
        yield f"{name:30} {method.group:24} {when}"


def _table2_methods() -> Iterator[str]:
    """A line for each method of Table 2; all run."""
    from ...evaluate.pose_methods import POSE_METHODS  # loads PyTorch

    for name, method in POSE_METHODS.items():
        yield f"{name:12} {method.about}"


def table1(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog table1``."""
    command = commands.add_parser(
        "table1",
        help="compare all methods on a folder of images",
        description="Inverts the descriptors of all images by all methods of the paper's Table 1 and writes the table: "
        "the page index.html, summary.csv, per_image.csv, times.csv and failures.csv. An interrupted run is "
        "resumed when it is repeated.",
    )
    options.images(command)
    several = {"dialects": DIALECTS, "dialects-learned": LEARNED_DIALECTS, "published": AS_PUBLISHED}
    options.table(command, TABLE1, _table1_methods, several)
    options.number(command, "--limit", "only the first N images")
    options.size(command, TABLE1_SIZE)
    options.minimiser(command)
    _prior_file(command, "prior", "uoctti-learned and others of signed descriptors")
    _prior_file(command, "unsigned-prior", "dalal-learned and others of unsigned descriptors")
    for method in TABLE1:
        if method in KINDS or method in TAKES_HOURS:
            _model_file(command, method)


def _prior_file(command: argparse.ArgumentParser, kind: str, methods: str) -> None:
    text = f"a file that `nablahog learn {TAKES_HOURS[kind]}` wrote, for {methods}"
    if kind in SHIPPED:
        text += " (default: the prior that comes with nablahog)"
    command.add_argument(f"--{kind}", dest=kind, type=options.path, metavar="FILE", help=text)


def _model_file(command: argparse.ArgumentParser, method: str) -> None:
    """Adds the option for the file that a method of Table 1 needs, which has the method's name."""
    text = f"a file that `nablahog learn {TAKES_HOURS.get(method, method)}` wrote, for the method {method}"
    if method not in TAKES_HOURS:
        text += " (default: learned once from photographs that come with scikit-image)"
    command.add_argument(f"--{method}", dest=method, type=options.path, metavar="FILE", help=text)


def table2(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog table2``."""
    command = commands.add_parser(
        "table2",
        help="compare all methods on objects of known pose",
        description="Finds the poses of many objects by all methods of the paper's Table 2 and writes the table: "
        "index.html to look at, summary.csv, median_error.csv, per_object.csv and failures.csv. The objects are "
        "procedural chairs in scenes that are rendered, or those of PASCAL VOC and PASCAL3D+. A run that was "
        "interrupted goes on when it is repeated.",
    )
    options.table(command, TABLE2, _table2_methods)
    options.number(command, "--objects", f"how many (default: {SCENES} scenes, or all of --pascal3d)")
    command.add_argument(
        "--models",
        type=options.path,
        metavar="DIR",
        help="folder of CAD models (default: procedural chairs, or those of --pascal3d)",
    )
    command.add_argument(
        "--viewpoints",
        type=options.path,
        metavar="CSV",
        help="viewpoints of the scenes: columns azimuth, elevation, and theta if known",
    )
    command.add_argument("--unknown-model", action="store_true", help="search among all models except the object's own")
    command.add_argument("--voc", type=options.path, metavar="DIR", help="the folder VOC2012 of PASCAL VOC")
    command.add_argument(
        "--pascal3d", type=options.path, metavar="DIR", help="the folder PASCAL3D+_release1.1; needs --voc"
    )
    options.seed(command)
