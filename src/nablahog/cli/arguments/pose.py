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
        help="find the pose of objects from CAD models",
        description="Finds the pose at which the HOG of a rendering is most similar to the photograph's. Of several "
        "models it takes the best. Writes poses.csv, poses.json and index.html.",
    )
    command.add_argument("photo", type=options.path, metavar="PHOTO", help="an image; with --annotations their folder")
    command.add_argument(
        "--mesh",
        type=options.path,
        metavar="PATH",
        help="a CAD model, or a folder of them (default: chairs of nablahog)",
    )
    command.add_argument(
        "--up", type=_axis, metavar="AXIS", help="the models' axis up, as --up=-z (default: by format)"
    )
    command.add_argument("--front", type=_axis, metavar="AXIS", help="the axis that their front looks along, likewise")
    options.output(command, "DIR", "folder for the results, made if missing")
    command.add_argument(
        "--box",
        action="append",
        type=numbers("x0,y0,x1,y1"),
        metavar="x0,y0,x1,y1",
        help="around the object, roughly, pixels; may be repeated",
    )
    command.add_argument(
        "--mask", type=options.path, metavar="FILE", help="an image, white where the object is, else black"
    )
    command.add_argument(
        "--annotations", type=options.path, metavar="FILE", help="a list of objects, CSV or JSON like COCO's"
    )
    options.workers(command)
    command.add_argument("--init", type=_view, metavar="az,el", help="initial azimuth and elevation, as --init=-30,10")
    command.add_argument(
        "--within", type=_degrees, default=180.0, metavar="DEGREES", help="of azimuth around the initial one"
    )
    command.add_argument(
        "--focal", type=_focal, metavar="PIXELS", help="focal length, exif or unknown (default: exif if there)"
    )
    command.add_argument(
        "--principal-point", type=numbers("x,y"), metavar="x,y", help="of the camera, pixels (default: the middle)"
    )
    command.add_argument(
        "--method",
        choices=get_args(SearchMethod),
        default="best",
        metavar="NAME",
        help=", ".join(get_args(SearchMethod)),
    )
    command.add_argument(
        "--least-confidence",
        type=_probability,
        default=LEAST_CONFIDENCE,
        metavar="P",
        help=f"below it the exit status is 4 (default: {LEAST_CONFIDENCE:g})",
    )
    options.seed(command)
    command.add_argument("--page", action="store_true", help="write a page for each object, too")
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")
