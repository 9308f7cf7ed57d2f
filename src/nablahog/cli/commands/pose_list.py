"""``nablahog pose`` of several objects: boxes of one photograph, or a list of annotations."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path

from ...hog.box import Box
from ...io.files import output_folder
from ...jobs.resume import do_all
from ...jobs.runner import cores
from ...paper.object_lists import ListedObject, read_objects
from ..errors import REFUSED, SOME_SKIPPED, UserError, as_user_error, forbid_overwrite, tell
from ..inputs.lens import LensOptions
from ..inputs.models import find_models, read_meshes
from ..results.pose_job import PoseJob, PoseOptions
from ..results.pose_list import NAMES, ObjectPose, as_json, rows, write
from ..terminal import counter, inform, print_table, say_page


def pose_list(arguments: Namespace) -> int:
    """Finds the poses of all objects; a run that was interrupted goes on where it ended.

    Returns:
        The exit status: 0; 3 if some objects have no pose, each with a line on stderr; 4 if some are less sure than was
        asked for.

    Raises:
        UserError: an input is unusable, or no object has a pose.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        annotations, photos = _objects(arguments)
        models = find_models(arguments)
    folder = Path(arguments.output)
    files = arguments.annotations, arguments.background, arguments.viewpoint_prior
    inputs = [*photos, *filter(None, files), *models.paths.values()]
    forbid_overwrite(inputs, [folder / name for name in NAMES])
    with output_folder(folder), as_user_error():
        meshes = read_meshes(models, arguments)
        options = PoseOptions(
            tuple((name, models.paths[name].absolute()) for name in meshes if models.paths),
            arguments.up,
            arguments.front,
            LensOptions.of(arguments),
            arguments.within,
            arguments.method,
            arguments.similarity,
            None if arguments.background is None else Path(arguments.background),
            None if arguments.viewpoint_prior is None else Path(arguments.viewpoint_prior),
            arguments.seed,
        )
        missing = {k: f"{photo}: no such file" for k, photo in enumerate(photos) if not photo.is_file()}
        jobs = {
            k: PoseJob(one, photo, options)
            for k, (one, photo) in enumerate(zip(annotations, photos, strict=True))
            if k not in missing
        }
        results = {}
        with counter("nablahog pose") as progress:
            workers = min(arguments.workers or cores(), max(len(jobs), 1))
            results = dict(do_all(folder, jobs, workers=workers, progress=progress))
        objects = []
        for k, one in enumerate(annotations):
            result = missing[k] if k in missing else results[k]
            if isinstance(result, str):
                objects.append(ObjectPose(one, None, failure=result))
            else:
                objects.append(ObjectPose(one, result.figures[0], result.pictures[0]))
        failed = [one for one in objects if one.figures is None]
        if len(failed) == len(objects):
            raise UserError(f"there is no pose of any object; the first: {_named(failed[0])}")
        for each in failed:
            tell("pose", f"skipped: {_named(each)}")
        write(folder, objects, arguments.least_confidence)
    if arguments.json:
        print(json.dumps(as_json(objects, arguments.least_confidence), indent=1, allow_nan=False))
    else:
        print_table(rows(objects))
        say_page(folder / NAMES[2])
    refused = sum(one.refused(arguments.least_confidence) for one in objects)
    if refused:
        inform(f"nablahog pose: refused: {refused} of {len(objects)} are less sure than {arguments.least_confidence:g}")
    if failed:
        return SOME_SKIPPED
    return REFUSED if refused else 0


def _objects(arguments: Namespace) -> tuple[list[ListedObject], list[Path]]:
    """What is known of the objects, and their photographs."""
    if arguments.mask is not None:
        raise ValueError("--mask is for one object: expected one --box, or none, and no --annotations")
    if arguments.annotations is None:
        if arguments.photos is not None:
            raise ValueError("--photos is the folder of the photographs of --annotations: expected both")
        boxes = [Box.of(sides) for sides in arguments.box]
        name = Path(arguments.photo).name
        objects = [ListedObject(k, name, box, arguments.init) for k, box in enumerate(boxes, 1)]
        return objects, [Path(arguments.photo)] * len(objects)
    if arguments.photo is not None or arguments.box or arguments.init is not None:
        raise ValueError("--annotations says which photographs, boxes and initial poses: expected no other")
    if arguments.photos is None:
        raise ValueError("--annotations needs the folder of its photographs: expected --photos")
    objects = read_objects(arguments.annotations)
    return objects, [Path(arguments.photos, one.image) for one in objects]


def _named(one: ObjectPose) -> str:
    image, reason = one.annotation.image, one.failure
    return f"object {one.annotation.id}: {reason if image in reason else f'{image}: {reason}'}"
