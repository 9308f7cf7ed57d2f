"""The arguments of ``nablahog pose``."""

from __future__ import annotations

import argparse

from ...requests.kinds import path
from ...requests.pose import PoseRequest
from . import options
from .options import Parser


def pose(commands: argparse._SubParsersAction[Parser]) -> None:
    command = commands.add_parser(
        "pose",
        usage="%(prog)s PHOTO -o DIR [options]",
        help="find the pose of objects from CAD models",
        description="Finds the viewpoint of objects in a photograph: the pose at which the HOG of a rendering of a CAD "
        "model is most similar to the photograph's. Writes poses.csv, poses.json and the page index.html.",
    )
    options.add(command, "photo", path("PHOTO"), "an image; with --annotations the folder of images")
    options.output(command, "DIR", "folder for the results, made if missing")
    options.add_request(command, PoseRequest)
    options.workers(command)
