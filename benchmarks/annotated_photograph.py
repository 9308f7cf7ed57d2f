"""The pose of one annotated chair, for an exact box, rough ones and none, with and without the viewpoint prior.

    python benchmarks/annotated_photograph.py PHOTO X0,Y0,X1,Y1 AZIMUTH [--models DIR] [--elevation 15]

Boxes are the one that is given, a fifth larger, three with each side a tenth of the width or height off, and none.
Without --models, candidates are the chairs that come with the package.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from nablahog.hog.box import Box
from nablahog.io.images import read_image
from nablahog.metrics import azimuth_error
from nablahog.paper.chairs import library
from nablahog.paper.models import Meshes, models_in
from nablahog.pose import default_viewpoints, estimate_pose

_OFF = {"larger": (-1, -1, 1, 1), "off 1": (1, -1, 1, -1), "off 2": (-1, -1, -1, 1), "off 3": (1, 1, -1, -1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photo", type=Path)
    parser.add_argument("box", help="pixels")
    parser.add_argument("azimuth", type=float, help="the true one, degrees")
    parser.add_argument("--models", type=Path, help="folder of CAD models")
    parser.add_argument("--elevation", type=float, default=15.0, help="given to the search, degrees")
    options = parser.parse_args()
    image = read_image(options.photo)
    models = library() if options.models is None else dict(Meshes(models_in(options.models)[0]))
    given = Box.of(map(float, options.box.split(",")))
    tenth = 0.1 * np.tile([given.width, given.height], 2)
    boxes: dict[str, Box | None] = {"exact": given}
    boxes |= {name: Box.of(np.array(given) + tenth * signs) for name, signs in _OFF.items()}
    boxes["none"] = None
    print("| box | error | confidence | error without a viewpoint prior |\n|---|---:|---:|---:|")
    for name, box in boxes.items():
        estimates = [
            estimate_pose(image, models, box=box, initial=(0.0, options.elevation), viewpoints=prior)
            for prior in (default_viewpoints(), None)
        ]
        errors = [float(azimuth_error(each.azimuth, options.azimuth)) for each in estimates]
        print(f"| {name} | {errors[0]:.1f}° | {estimates[0].confidence:.2f} | {errors[1]:.1f}° |", flush=True)


if __name__ == "__main__":
    main()
