"""The arguments of ``nablahog pose``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import get_args

from ...pose.options import SearchMethod
from . import options
from .options import Parser, numbers

LEAST_CONFIDENCE = 0.3


def _number(name: str, holds: Callable[[float], bool], expected: str) -> Callable[[str], float]:
    """Parses a number for which ``holds`` is true."""

    def parse(text: str) -> float:
        (number,) = numbers(name)(text)
        if not holds(number):
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
        return number

    return parse


_degrees = _number("DEGREES", lambda degrees: 0 < degrees <= 180, "a number above 0 and at most 180")
_probability = _number("P", lambda probability: 0 <= probability <= 1, "a probability in 0…1")
_pixels = _number("PIXELS", lambda pixels: pixels > 0, "a number above 0, exif or unknown")


def _focal(text: str) -> float | str:
    if text.lower().endswith("mm"):
        raise argparse.ArgumentTypeError(
            f"expected pixels, got {text!r}: multiply by the photograph's diagonal, in pixels, over the sensor's, "
            "which is 43.3mm if the lens is named by its equivalent for 35mm film"
        )
    return text if text in ("exif", "unknown") else _pixels(text)


def _view(text: str) -> tuple[float, ...]:
    azimuth, elevation = numbers("az,el")(text)
    if not -90 <= elevation <= 90:
        raise argparse.ArgumentTypeError(f"expected an elevation in -90…90 degrees, got {text!r}")
    return azimuth, elevation


def _axis(text: str) -> str:
    if not re.fullmatch("[+-]?[xyz]", text):
        raise argparse.ArgumentTypeError(f"expected x, y or z, with a sign or without, got {text!r}")
    return text


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "pose",
        usage="%(prog)s PHOTO -o DIR [options]",
        help="find the pose of objects from CAD models",
        description="Finds the viewpoint of objects in a photograph: the pose at which the HOG of a rendering of a CAD "
        "model is most similar to the photograph's. Writes poses.csv, poses.json and the page index.html.",
    )
    options.file(command, "photo", "PHOTO", "an image; with --annotations the folder of images")
    options.file(
        command,
        "--mesh",
        "FILE_or_DIR",
        "a CAD model: OFF, PLY, STL, OBJ, GLB, or a folder of them (default: the chairs of nablahog.sample_chairs)",
    )
    command.add_argument(
        "--up",
        type=_axis,
        metavar="AXIS",
        help="the axis of the models that points up, such as --up=-z (default: y for OBJ, GLB and glTF, else z)",
    )
    command.add_argument(
        "--front",
        type=_axis,
        metavar="AXIS",
        help="the axis that their front faces (default: -y if z is up, +z if y is up)",
    )
    options.output(command, "DIR", "folder for the results, made if missing")
    command.add_argument(
        "--box",
        action="append",
        type=numbers("x0,y0,x1,y1"),
        metavar="x0,y0,x1,y1",
        help="a rough box around each object, in pixels; repeatable (default: search everywhere)",
    )
    options.file(command, "--mask", "FILE", "an image, white where the object is, black elsewhere")
    options.file(
        command,
        "--annotations",
        "FILE",
        "list of objects: .csv with image and, if known, x0, y0, x1, y1, azimuth, elevation; or .json like COCO's",
    )
    options.workers(command)
    command.add_argument(
        "--init",
        type=_view,
        metavar="az,el",
        help="initial azimuth and elevation, roughly, if known, such as --init=-30,10",
    )
    command.add_argument(
        "--within",
        type=_degrees,
        default=180.0,
        metavar="DEGREES",
        help="most that the azimuth may differ from --init (default: 180)",
    )
    command.add_argument(
        "--focal",
        type=_focal,
        metavar="PIXELS",
        help="focal length in pixels, exif to read it from the file, or unknown (default: exif if the file has it)",
    )
    command.add_argument(
        "--principal-point",
        type=numbers("x,y"),
        metavar="x,y",
        help="where the optical axis is, in pixels (default: the middle)",
    )
    options.choice(command, "--method", get_args(SearchMethod), f"how to search: {', '.join(get_args(SearchMethod))}")
    command.add_argument(
        "--least-confidence",
        type=_probability,
        default=LEAST_CONFIDENCE,
        metavar="P",
        help="exit with status 4 if the rotation is less likely than P to be within 15 degrees "
        f"(default: {LEAST_CONFIDENCE:g})",
    )
    options.seed(command)
    command.add_argument("--page", action="store_true", help="write a page of pictures for each object, too")
