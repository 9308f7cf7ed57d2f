"""``nablahog track``: one object through the frames of a video."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from ...io.files import output_folder
from ...io.images import image_endings, read_image
from ...paper.object_lists import ListedObject
from ...pose import Tracker
from ...pose.crop import checked_box
from ..errors import UserError, as_user_error, forbid_overwrite
from ..inputs.expand import expand
from ..inputs.lens import LensOptions
from ..inputs.models import find_models, read_meshes
from ..results.pose_job import pose_figures
from ..results.pose_list import NAMES, ObjectPose, as_json, rows, write
from ..terminal import counter, print_table, say, say_page

SHOWN = 10  # frames in the table on the terminal
NOT_SEEN = "the object is not seen"


def track(arguments: Namespace) -> None:
    """Follows the object; writes its pose in each frame.

    Raises:
        UserError: an input is unusable, or the object is seen in no frame.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        models = find_models(arguments)
        if len(models.paths) != 1:
            raise ValueError(f"{arguments.mesh}: expected the model of the object, got {len(models.paths)} models")
        paths = expand(arguments, image_endings()).paths
    folder = Path(arguments.output)
    forbid_overwrite([*paths, *models.paths.values()], [folder / name for name in NAMES])
    with output_folder(folder), as_user_error():
        ((name, mesh),) = read_meshes(models, arguments).items()
        first = read_image(paths[0])
        lens = LensOptions.of(arguments).lens(paths[0], *first.shape[1:])
        box = None if arguments.box is None else checked_box(arguments.box, *first.shape[1:])
        tracker = Tracker(
            mesh,
            focal=lens.focal,
            principal_point=lens.principal_point,
            box=box,
            initial=arguments.init,
            seed=arguments.seed,
        )
        objects = []
        with counter("nablahog track") as progress:
            for k, path in enumerate(paths):
                progress(k, len(paths), path)
                frame = read_image(path)
                if frame.shape[1:] != first.shape[1:]:
                    expected, got = ("x".join(map(str, each.shape[1:])) for each in (first, frame))
                    raise ValueError(f"{path}: expected a frame of {expected} pixels, as the first one, got {got}")
                estimate = tracker(frame)
                annotation = ListedObject(k + 1, Path(path).name)
                if estimate is None:
                    objects.append(ObjectPose(annotation, None, failure=NOT_SEEN))
                else:
                    estimate = replace(estimate, model=name, focal_from=lens.source)
                    objects.append(ObjectPose(annotation, pose_figures(estimate)))
        seen = sum(one.figures is not None for one in objects)
        if not seen:
            raise UserError(f"the object is seen in none of the {len(paths)} frames")
        write(folder, objects, 0.0)
    if arguments.json:
        print(json.dumps(as_json(objects, 0.0), indent=1, allow_nan=False))
        return
    print_table(rows(objects[:SHOWN]))
    say(f"The object is seen in {seen} of {len(objects)} frames; the table has the first {min(SHOWN, len(objects))}")
    say_page(folder / NAMES[2])
