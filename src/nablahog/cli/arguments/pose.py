"""The arguments of ``nablahog pose``."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import get_args

from ...pose.options import SearchMethod, SimilarityKind
from . import options
from .options import Parser, numbers

LEAST_CONFIDENCE = 0.3


def _positive(most: float) -> Callable[[str], float]:
    """Parses one number above 0, and at most ``most``."""

    def parse(text: str) -> float:
        (number,) = numbers("NUMBER")(text)
        if not 0 < number <= most:
            limit = f" and at most {most:g}" if most < math.inf else ""
            raise argparse.ArgumentTypeError(f"expected a number above 0{limit}, got {text!r}")
        return number

    return parse


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
    return text if text in ("exif", "unknown") else _positive(math.inf)(text)


def camera(command: argparse.ArgumentParser) -> None:
    """Adds the options that say what is known of the camera."""
    lens = command.add_mutually_exclusive_group()
    lens.add_argument(
        "--focal",
        type=_focal,
        metavar="PIXELS|exif|unknown",
        help="focal length of the camera, in pixels of the photograph; exif: as the file says, an error if it does "
        "not; unknown: such that an object that fills its box is 3 of its diagonals away (default: as the file says, "
        "if it does, else unknown)",
    )
    lens.add_argument(
        "--field-of-view",
        type=_positive(179),
        metavar="DEGREES",
        help="of the camera from the upper to the lower border of the photograph, instead of --focal",
    )
    command.add_argument(
        "--principal-point",
        type=numbers("x,y"),
        metavar="x,y",
        help="where the optical axis meets the photograph, in pixels from the upper left corner, if the focal length "
        "is known (default: the middle)",
    )


def models(command: argparse.ArgumentParser, several: str, *, required: bool = False) -> None:
    """Adds the options for CAD models; ``several`` says what a folder means."""
    command.add_argument(
        "--mesh",
        required=required,
        type=options.path,
        metavar="FILE_or_DIR",
        help=f"a CAD model (OFF, PLY or STL: z up, front at -y; OBJ or GLB: y up, front at +z){several}",
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


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog pose``."""
    command = commands.add_parser(
        "pose",
        help="find the pose of an object from CAD models",
        description="Finds the viewpoint of an object in a photograph: the pose at which the HOG of a rendering of a "
        "CAD model is most similar to the photograph's. Of several models it takes the one that fits best. Without "
        "--mesh these are chairs that come with nablahog, of all common kinds. Writes "
        "<stem>_overlay.png, _elements.png, _similarity.svg, _pose.json and the page index.html; of several objects "
        "poses.csv and poses.json.",
    )
    command.add_argument(
        "photo",
        nargs="?",
        type=options.path,
        metavar="PHOTO",
        help="an image of any format that Pillow reads; with --annotations there is none",
    )
    models(command, ", or a folder of them (default: the chairs of nablahog.sample_chairs)")
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
        help="an image of the photograph's size, white where the object is, black elsewhere: what is elsewhere does "
        "not count, and the box is that of the white part",
    )
    command.add_argument(
        "--annotations",
        type=options.path,
        metavar="FILE",
        help="a list of objects instead of PHOTO: .csv with the column image and perhaps x0, y0, x1, y1, azimuth and "
        "elevation, or .json like COCO's; writes poses.csv and poses.json, and resumes an interrupted run",
    )
    command.add_argument(
        "--photos", type=options.path, metavar="DIR", help="folder of the photographs that --annotations names"
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
        type=_positive(180),
        default=180.0,
        metavar="DEGREES",
        help="of azimuth on both sides of the initial one that the method best searches (default: 180, which is all)",
    )
    camera(command)
    command.add_argument(
        "--method", choices=get_args(SearchMethod), default="best", help="how to search (default: best)"
    )
    command.add_argument(
        "--similarity",
        choices=get_args(SimilarityKind),
        help="of descriptors (default: patches for the paper's methods, calibrated for the others)",
    )
    command.add_argument(
        "--background",
        type=options.path,
        metavar="FILE",
        help="a file that `nablahog learn background` wrote; it also says which descriptor to use "
        "(default: aubry, gray, cells of 8, learned from the photographs in scikit-image)",
    )
    command.add_argument(
        "--viewpoint-prior",
        type=options.path,
        metavar="FILE",
        help="a file that `nablahog learn viewpoints` wrote: from which side an object is seen, which counts among "
        "several models of a class that it knows; 'none' for none (default: that of chairs that comes with nablahog)",
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
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")
