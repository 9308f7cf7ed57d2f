"""The arguments of ``nablahog table1`` and ``nablahog table2``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from ...paper.names import (
    AS_PUBLISHED,
    CONDITIONS,
    DIALECTS,
    LEARNED_DIALECTS,
    PRIORS,
    TABLE1,
    TABLE2,
)
from . import options
from .did_you_mean import did_you_mean
from .learn import KINDS
from .options import Parser

TABLE1_SIZE = 128  # that of the paper's images
SCENES = 200  # of Table 2
HARDER = 20  # objects in each of its conditions


def _table1_methods() -> Iterator[str]:
    """A line for each method of Table 1: its name, its input, and when it runs."""
    from ...paper.methods import METHODS  # loads PyTorch

    for name, method in METHODS.items():
        when = "with --methods only" if method.asked else "runs"
        for kind in set(method.needs) - set(PRIORS):
            when = f"runs; learns {kind} the first time"
        yield f"{name:30} {method.group:24} {when}"


def _table2_methods() -> Iterator[str]:
    """A line for each method of Table 2; all run."""
    from ...paper.pose_methods import POSE_METHODS  # loads PyTorch

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
        if method in KINDS:
            _model_file(command, method)


def _prior_file(command: argparse.ArgumentParser, kind: str, methods: str) -> None:
    text = f"a file that `nablahog learn {PRIORS[kind]}` wrote, for {methods} (default: the prior of nablahog)"
    command.add_argument(f"--{kind}", dest=kind, type=options.path, metavar="FILE", help=text)


def _model_file(command: argparse.ArgumentParser, method: str) -> None:
    """Adds the option for the file that a method of Table 1 needs, which has the method's name."""
    text = f"a file that `nablahog learn {method}` wrote (default: learned once from photographs of scikit-image)"
    command.add_argument(f"--{method}", dest=method, type=options.path, metavar="FILE", help=text)


def _conditions(text: str) -> list[str]:
    """Parses names of conditions."""
    sets = {"none": (), "all": CONDITIONS}
    names = [name for part in text.split(",") for name in sets.get(part, (part,))]
    for name in names:
        if name not in CONDITIONS:
            meant = did_you_mean(name, [*CONDITIONS, *sets])
            raise argparse.ArgumentTypeError(f"expected conditions of {', '.join(CONDITIONS)}, got {name!r}{meant}")
    return list(dict.fromkeys(names))


def table2(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog table2``."""
    command = commands.add_parser(
        "table2",
        help="compare all methods on objects of known pose",
        description="Finds the poses of many objects by all methods of the paper's Table 2 and writes the table: the "
        "page index.html, summary.csv, per_object.csv and failures.csv. The objects are chairs in scenes that are "
        "rendered, those of PASCAL VOC and PASCAL3D+, or photographs of your own. A second table has fewer of them "
        "under harder conditions. An interrupted run is resumed when it is repeated.",
    )
    options.table(command, TABLE2, _table2_methods)
    options.number(command, "--objects", f"how many (default: {SCENES} scenes, or all photographs)")
    _folder(
        command,
        "--models",
        "folder of CAD models (default: procedural chairs; those of --pascal3d; with --photos, the chairs of "
        "nablahog.sample_chairs)",
    )
    command.add_argument("--unknown-model", action="store_true", help="search among all models except the object's own")
    command.add_argument(
        "--conditions",
        type=_conditions,
        metavar="NAME,…",
        help="of the second table: none, all, or some of "
        f"{', '.join(CONDITIONS)} (default: all; of photographs, those of the box; of --pascal3d, none)",
    )
    options.number(
        command, "--condition-objects", f"how many in each condition (default: {HARDER}, at most as many as --objects)"
    )
    command.add_argument(
        "--viewpoints",
        type=options.path,
        metavar="CSV",
        help="viewpoints of the scenes: columns azimuth, elevation, and theta if known",
    )
    _folder(command, "--voc", "the folder VOC2012 of PASCAL VOC")
    _folder(command, "--pascal3d", "the folder PASCAL3D+_release1.1; needs --voc")
    _folder(command, "--photos", "photographs of your own, instead of scenes; needs --annotations")
    command.add_argument(
        "--annotations",
        type=options.path,
        metavar="CSV",
        help="the objects of --photos, one a line: columns image, x0, y0, x1, y1 in pixels, azimuth, elevation, theta "
        "in degrees, and model if known",
    )
    options.seed(command)


def _folder(command: argparse.ArgumentParser, name: str, text: str) -> None:
    command.add_argument(name, type=options.path, metavar="DIR", help=text)
