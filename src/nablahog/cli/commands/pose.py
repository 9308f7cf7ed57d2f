"""``nablahog pose``: the poses of objects in photographs."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from pathlib import Path

from ...hog.box import Box
from ...io.files import check_folder, output_folder
from ...jobs.store import JobResult, do_all
from ...jobs.worker import cores
from ...paper.lists import ListedObject, read_objects
from ...paper.models import Models, read_models
from ...render.mesh import axes
from ..errors import REFUSED, SOME_SKIPPED, UserError, as_user_error, forbid_overwrite, tell
from ..results.pose_files import PosedObject, as_json, names, rows, write
from ..results.pose_job import ObjectJob, PoseOptions
from ..terminal import counter, inform, print_table, say_page


def pose(arguments: Namespace) -> int:
    """Finds the poses of all objects; a run of many objects that was interrupted goes on where it ended.

    Returns:
        The exit status: 0; 3 if some objects have no pose, each with a line on stderr; 4 if some are less sure than was
        asked for.
    """
    with as_user_error():
        objects, photos = _objects(arguments)
        models = _models(arguments)
    folder = Path(arguments.output)
    inputs = [*photos, *filter(None, (arguments.annotations, arguments.mask)), *models.paths.values()]
    forbid_overwrite(inputs, [folder / name for name in names(objects, arguments.page)])
    with output_folder(folder), as_user_error():
        options = PoseOptions.of(arguments, _readable(models, arguments))
        mask = None if arguments.mask is None else Path(arguments.mask)
        jobs = [ObjectJob(one, photo, mask, options) for one, photo in zip(objects, photos, strict=True)]
        results = _run(folder, jobs, arguments)
        least = arguments.least_confidence
        posed = [PosedObject.of(one, result, least) for one, result in zip(objects, results, strict=True)]
        failed = [one for one in posed if not one.figures]
        if len(failed) == len(posed):
            raise UserError(f"there is no pose of any object; the first: {_named(failed[0])}")
        for each in failed:
            tell("pose", f"skipped: {_named(each)}")
        write(folder, posed, least)
    if arguments.json:
        print(json.dumps(as_json(posed), indent=1, allow_nan=False))
    else:
        print_table(rows(posed))
        say_page(folder / "index.html")
    return _status(posed, least)


def _run(folder: Path, jobs: list[ObjectJob], arguments: Namespace) -> list[JobResult | str]:
    """The result of each job, or why there is none; a single one is done in this process, and is not stored."""
    with counter("nablahog pose") as progress:
        if len(jobs) == 1:
            return [jobs[0].run(progress)]
        missing = {k: f"{job.photo}: no such file" for k, job in enumerate(jobs) if not job.photo.is_file()}
        there = {k: job for k, job in enumerate(jobs) if k not in missing}
        workers = min(arguments.workers or cores(), max(len(there), 1))
        done = dict(do_all(folder, there, workers=workers, progress=progress))
        return [missing[k] if k in missing else done[k] for k in range(len(jobs))]


def _objects(arguments: Namespace) -> tuple[list[ListedObject], list[Path]]:
    """What is known of the objects, and their photographs."""
    photo = Path(arguments.photo)
    if arguments.annotations is None:
        boxes: list[Box | None] = [Box.of(sides) for sides in arguments.box or ()] or [None]
        if arguments.mask is not None and len(boxes) > 1:
            raise ValueError("--mask is for one object: expected one --box, or none")
        objects = [ListedObject(k, photo.name, box, arguments.init) for k, box in enumerate(boxes, 1)]
        return objects, [photo] * len(objects)
    if arguments.box or arguments.init is not None or arguments.mask is not None:
        raise ValueError("--annotations says which boxes and initial poses: expected no --box, --init or --mask")
    check_folder(photo, "the photographs of --annotations")
    objects = read_objects(arguments.annotations)
    return objects, [photo / one.image for one in objects]


def _models(arguments: Namespace) -> Models:
    """The models in the folder or file ``arguments.mesh``, not read yet; none for those of the package."""
    if arguments.mesh is None:
        if arguments.up or arguments.front:
            raise ValueError("--up and --front say how the files of --mesh lie; the chairs of nablahog need neither")
        return Models({}, [])
    if arguments.up is not None:
        axes(arguments.up, arguments.front)
    path = Path(arguments.mesh)
    if path.is_dir():
        return read_models(path)
    return Models({os.fsencode(path.stem).decode(errors="backslashreplace"): path}, [])


def _readable(models: Models, arguments: Namespace) -> dict[str, Path]:
    """The models that can be read, with progress; a line on stderr for each other, or ValueError if there is none."""
    readable = {}
    with counter("nablahog pose") as progress:
        for model, _ in models.meshes(arguments.up, arguments.front):
            readable[model] = models.paths[model]
            progress(len(readable) + len(models.failed), len(models.paths), f"reading {model}")
    if models.failed and not readable:
        model, reason = next(iter(models.failed.items()))
        first = "no model can be read; the first: " if len(models.paths) > 1 else ""
        raise ValueError(f"{first}{models.paths[model]}: {reason}")
    for model, reason in (*models.failed.items(), *((other, "no model by its ending") for other in models.ignored)):
        inform(f"nablahog pose: skipped: {model}: {reason}")
    return readable


def _status(posed: list[PosedObject], least_confidence: float) -> int:
    """The exit status; says how many poses may mean nothing, and how many are refused."""
    warnings = [one.figures["warning"] for one in posed if one.figures.get("warning") is not None]
    if warnings:
        of_all = "" if len(posed) == 1 else f"{len(warnings)} of {len(posed)} objects; the first: "
        inform(f"nablahog pose: warning: {of_all}{warnings[0]}")
    refused = sum(one.refused for one in posed)
    if refused:
        inform(
            f"nablahog pose: refused: {refused} of {len(posed)} have their azimuth within 15 degrees of the true one "
            f"with a probability below {least_confidence:g}: the object may not be there, or be unlike the model"
        )
    if not all(one.figures for one in posed):
        return SOME_SKIPPED
    return REFUSED if refused else 0


def _named(one: PosedObject) -> str:
    image, reason = one.listed.image, one.failure
    return f"object {one.listed.id}: {reason if image in reason else f'{image}: {reason}'}"
