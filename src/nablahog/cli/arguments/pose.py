"""The arguments of ``nablahog pose``."""

from __future__ import annotations

import argparse
import math
import re
from typing import get_args

from ...pose.options import SearchMethod
from . import options
from .options import Parser, numbers

LEAST_CONFIDENCE = 0.3


def _degrees(text: str) -> float:
    (number,) = numbers("DEGREES")(text)
    if not 0 < number <= 180:
        raise argparse.ArgumentTypeError(f"expected a number above 0 and at most 180, got {text!r}")
    return number


def _view(text: str) -> tuple[float, ...]:
    azimuth, elevation = numbers("az,el")(text)
    if not -90 <= elevation <= 90:
        raise argparse.ArgumentTypeError(f"expected an elevation in -90…90 degrees, got {text!r}")
    return azimuth, elevation


def _axis(text: str) -> str:
    if not re.fullmatch("[+-]?[xyz]", text):
        raise argparse.ArgumentTypeError(f"expected x, y or z, with a sign or without, got {text!r}")
    return text


def _probability(text: str) -> float:
    (probability,) = numbers("P")(text)
    if not 0 <= probability <= 1:
        raise argparse.ArgumentTypeError(f"expected a probability in 0…1, got {text!r}")
    return probability


def _focal(text: str) -> float | str:
    if text in ("exif", "unknown"):
        return text
    (number,) = numbers("PIXELS")(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0, exif or unknown, got {text!r}")
    return number


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog pose``."""
    command = commands.add_parser(
        "pose",
        usage="%(prog)s PHOTO -o DIR [options]",
        help="find the pose of objects from CAD models",
        description="Finds the viewpoint of objects in a photograph: the pose at which the HOG of a rendering of a CAD "
        "model is most similar to the photograph's. Writes poses.csv, poses.json and the page index.html.",
    )
    command.add_argument(
        "photo",
        type=options.path,
        metavar="PHOTO",
        help="an image; with --annotations the folder of images",
    )
    command.add_argument(
        "--mesh",
        type=options.path,
        metavar="FILE_or_DIR",
        help="a CAD model: OFF, PLY, STL, OBJ, GLB, or a folder of them (default: the chairs of "
        "nablahog.sample_chairs)",
    )
    command.add_argument(
        "--up",
        type=_axis,
        metavar="AXIS",
        help="which axis of the models points up, as --up=-z (default: y of OBJ and GLB, else z)",
    )
    command.add_argument(
        "--front",
        type=_axis,
        metavar="AXIS",
        help="which axis their front looks along (default: -y with z up, +z with y up)",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    command.add_argument(
        "--box",
        action="append",
        type=numbers("x0,y0,x1,y1"),
        metavar="x0,y0,x1,y1",
        help="roughly around the object, in pixels; repeated for several objects (default: anywhere)",
    )
    command.add_argument(
        "--mask",
        type=options.path,
        metavar="FILE",
        help="an image, white at the one object, black elsewhere",
    )
    command.add_argument(
        "--annotations",
        type=options.path,
        metavar="FILE",
        help="objects: .csv with the column image, and x0, y0, x1, y1, azimuth, elevation if known, or .json like "
        "COCO's",
    )
    options.workers(command)
    command.add_argument(
        "--init",
        type=_view,
        metavar="az,el",
        help="degrees to begin at, such as --init=-30,10",
    )
    command.add_argument(
        "--within",
        type=_degrees,
        default=180.0,
        metavar="DEGREES",
        help="of azimuth on both sides of --init (default: 180)",
    )
    command.add_argument(
        "--focal",
        type=_focal,
        metavar="PIXELS",
        help="focal length in pixels, exif for that of the file, or unknown (default: exif if there, else unknown)",
    )
    command.add_argument(
        "--principal-point",
        type=numbers("x,y"),
        metavar="x,y",
        help="of the optical axis, in pixels (default: the middle)",
    )
    command.add_argument(
        "--method",
        choices=get_args(SearchMethod),
        default="best",
        metavar="NAME",
        help=f"how to search: {', '.join(get_args(SearchMethod))} (default: best)",
    )
    command.add_argument(
        "--least-confidence",
        type=_probability,
        default=LEAST_CONFIDENCE,
        metavar="P",
        help="exit with status 4 if the azimuth is within 15 degrees with a lower probability "
        f"(default: {LEAST_CONFIDENCE:g})",
    )
    options.seed(command)
    command.add_argument(
        "--page",
        action="store_true",
        help="write a page of pictures for each object, too",
    )
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")
