"""The arguments of the commands of Section 3.2: ``nablahog pose``, ``table2`` and ``learn exemplars``."""

from __future__ import annotations

import argparse
from typing import get_args

from ...evaluate.names import TABLE2
from ...pose.options import SearchMethod, SimilarityKind
from . import options
from .options import Parser, integer, numbers

SCENES = 200  # of Table 2


def _view(text: str) -> tuple[float, ...]:
    azimuth, elevation = numbers("az,el")(text)
    if not -90 <= elevation <= 90:
        raise argparse.ArgumentTypeError(f"expected an elevation in -90…90 degrees, got {text!r}")
    return azimuth, elevation


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog pose``."""
    command = commands.add_parser(
        "pose",
        help="find the pose of an object from CAD models",
        description="Finds from where an object in a photograph is seen: the pose at which a rendering of a CAD model "
        "has the HOG most like the photograph's. Of several models it takes the one that fits best. Leaves "
        "<stem>_overlay.png, _similarity.png, _elements.png and _pose.json in the folder, and index.html to look at.",
    )
    command.add_argument("photo", metavar="PHOTO", help="an image of any format that Pillow reads")
    command.add_argument(
        "--mesh",
        required=True,
        metavar="FILE_or_DIR",
        help="a CAD model (OFF, PLY or STL: z up and its front to -y; OBJ or GLB: y up and its front to +z), or a "
        "folder of them",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    command.add_argument(
        "--box",
        type=numbers("x0,y0,x1,y1"),
        metavar="x0,y0,x1,y1",
        help="around the object, in pixels from the upper left corner (default: the whole photograph)",
    )
    command.add_argument(
        "--init",
        type=_view,
        metavar="az,el",
        help="azimuth and elevation to begin at, in degrees, as --init=-30,10 if below 0 (default: unknown)",
    )
    command.add_argument(
        "--method", choices=get_args(SearchMethod), default="best", help="of the search (default: best)"
    )
    command.add_argument(
        "--similarity",
        choices=get_args(SimilarityKind),
        help="of descriptors (default: dot for the paper's method, calibrated for the others)",
    )
    command.add_argument(
        "--background",
        metavar="FILE",
        help="what `nablahog learn background` wrote, of the descriptor to use "
        "(default: aubry, gray, cells of 8, learned from photographs that come with scikit-image)",
    )
    options.seed(command)
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")


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
    options.table(command, TABLE2)
    command.add_argument(
        "--objects", type=integer(1), metavar="N", help=f"how many (default: {SCENES} scenes, or all of --pascal3d)"
    )
    command.add_argument(
        "--models", metavar="DIR", help="folder of CAD models (default: procedural chairs, or those of --pascal3d)"
    )
    command.add_argument(
        "--viewpoints", metavar="CSV", help="viewpoints of the scenes: columns azimuth, elevation, and theta if known"
    )
    command.add_argument(
        "--unknown-model", action="store_true", help="leave an object's own model out, and choose among all others"
    )
    command.add_argument("--voc", metavar="DIR", help="the folder VOC2012 of PASCAL VOC")
    command.add_argument("--pascal3d", metavar="DIR", help="the folder PASCAL3D+_release1.1; needs --voc")
    options.seed(command)


def exemplars(kinds: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog learn exemplars``."""
    command = kinds.add_parser(
        "exemplars",
        help="what CAD models look like from all around, for the baseline of Table 2",
        description="Renders each model from 62 viewpoints and finds the discriminative elements of each rendering, as "
        "Aubry et al. do. What is learned of a model is kept in a file of its own, so a run that was interrupted goes "
        "on when it is repeated.",
    )
    command.set_defaults(command="learn exemplars")
    command.add_argument(
        "--models", required=True, metavar="DIR", help="folder of CAD models, as for `nablahog pose --mesh`"
    )
    options.output(command, "DIR", "folder to keep them in, made if missing")
    command.add_argument(
        "--background",
        metavar="FILE",
        help="what `nablahog learn background --cell 5` wrote (default: learned from photographs that come with "
        "scikit-image)",
    )
    options.workers(command)
