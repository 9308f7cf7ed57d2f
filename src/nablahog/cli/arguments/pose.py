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
        description="Finds the viewpoint of objects in photographs: the pose at which the HOG of a rendering of a CAD "
        "model is most similar to the photograph's. Of several models it takes the one that fits best. Without --mesh "
        "these are chairs that come with nablahog, of all common kinds. Writes poses.csv, poses.json and the page "
        "index.html.",
    )
    command.add_argument(
        "photo",
        type=options.path,
        metavar="PHOTO",
        help="an image of any format that Pillow reads; with --annotations the folder of the photographs",
    )
    command.add_argument(
        "--mesh",
        type=options.path,
        metavar="FILE_or_DIR",
        help="a CAD model (OFF, PLY or STL: z up, front at -y; OBJ or GLB: y up, front at +z), or a folder of them "
        "(default: the chairs of nablahog.sample_chairs)",
    )
    command.add_argument(
        "--up",
        type=_axis,
        metavar="AXIS",
        help="which axis of the models' files points up: x, y or z, with a sign or without (default: by format, see "
        "--mesh); write --up=-z if negative",
    )
    command.add_argument(
        "--front",
        type=_axis,
        metavar="AXIS",
        help="which axis the front of the models looks along, likewise (default: -y with z up, +z with y up)",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    command.add_argument(
        "--box",
        action="append",
        type=numbers("x0,y0,x1,y1"),
        metavar="x0,y0,x1,y1",
        help="around the object, in pixels from the upper left corner, roughly (default: anywhere in the photograph; "
        "the whole photograph for methods other than best); may be repeated, for several objects",
    )
    command.add_argument(
        "--mask",
        type=options.path,
        metavar="FILE",
        help="of a single object: an image of the photograph's size, white where the object is, black elsewhere",
    )
    command.add_argument(
        "--annotations",
        type=options.path,
        metavar="FILE",
        help="a list of objects: .csv with the column image and perhaps x0, y0, x1, y1, azimuth and elevation, or "
        ".json like COCO's; an interrupted run is resumed",
    )
    options.workers(command)
    command.add_argument(
        "--init",
        type=_view,
        metavar="az,el",
        help="initial azimuth and elevation in degrees; write --init=-30,10 if negative (default: unknown). The method "
        "best searches all azimuths all the same, unless there is --within",
    )
    command.add_argument(
        "--within",
        type=_degrees,
        default=180.0,
        metavar="DEGREES",
        help="of azimuth on both sides of the initial one that the method best searches (default: 180, which is all)",
    )
    command.add_argument(
        "--focal",
        type=_focal,
        metavar="PIXELS|exif|unknown",
        help="focal length of the camera, in pixels of the photograph; exif: as the file says, an error if it does "
        "not; unknown: such that an object that fills its box is 3 of its diagonals away (default: as the file says, "
        "if it does, else unknown)",
    )
    command.add_argument(
        "--principal-point",
        type=numbers("x,y"),
        metavar="x,y",
        help="where the optical axis meets the photograph, in pixels from the upper left corner, if the focal length "
        "is known (default: the middle)",
    )
    command.add_argument(
        "--method", choices=get_args(SearchMethod), default="best", help="how to search (default: best)"
    )
    command.add_argument(
        "--least-confidence",
        type=_probability,
        default=LEAST_CONFIDENCE,
        metavar="P",
        help="refuse a pose whose azimuth is within 15 degrees with a lower probability: exit status 4, after the "
        f"results have been written (default: {LEAST_CONFIDENCE:g})",
    )
    options.seed(command)
    command.add_argument(
        "--page",
        action="store_true",
        help="write a page for each object, too: overlays, the similarity by azimuth, and the visual elements",
    )
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")
