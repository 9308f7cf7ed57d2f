"""``nablahog pose``: the poses of objects in photographs."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ...inputs.arrays import as_mask
from ...inputs.boxes import Box
from ...io.arrays import naming
from ...io.camera_file import read_camera_file
from ...io.files import check_folder, forbid_overwrite, local_name, output_folder
from ...io.images import draw_polygons, read_exif_focal, read_image
from ...io.lists import AnnotatedObject, read_objects
from ...jobs.store import JobResult, digest, do_all, make_key
from ...jobs.worker import cores, local_path
from ...pose import estimate_pose
from ...pose.crop import apply_mask
from ...pose.lens import Lens, choose_lens, join_distortion
from ...pose.result import DOUBT, pose_figures
from ...render.mesh import Y_UP, axes
from ...render.models import SAMPLE_CHAIRS, Model, archived_models, check_models, read_models
from ...requests.pose import FROM_FILE, UNKNOWN, PoseRequest
from ...runtime.cache import code_key
from ...runtime.pytorch import in_plain_mode
from ...runtime.text import to_unicode
from ..arguments.options import build_request
from ..errors import REFUSED, SOME_SKIPPED, WrongArguments, blaming_arguments, tell
from ..results.pose_files import PosedObject, names, position_rows, rows, write
from ..results.pose_page import pose_page
from ..results.pose_pictures import join_pictures, joined_shape
from ..results.pose_table import say_assumed
from ..terminal import counter, inform, print_table, say, say_page

_NO_PART_OF_A_RESULT: dict[str, Any] = {"mesh": None, "mask": None, "annotations": None, "least_confidence": 0.0}
"""Fields of a request that do not change a stored result: the content of files counts, not their names."""


def pose(arguments: Namespace) -> int:
    """Finds the poses of all objects; an interrupted run of many objects is resumed when it is repeated.

    Returns:
        The exit status: 0; 3 if some objects have no pose, each with a line on stderr; 4 if some are less sure than was
        asked for.
    """
    request = _read_camera(build_request(PoseRequest, arguments))
    objects, photos = _objects(arguments)
    if request.within < 180 and all(one.view is None for one in objects):
        raise WrongArguments("--within needs --init, or azimuth and elevation in --annotations")
    models, ignored = _models(request)
    folder = Path(arguments.output)
    inputs: list[str | Path] = [
        *photos,
        *(file for file in (request.annotations, request.mask) if file),
        *(model.file for model in models),
    ]
    forbid_overwrite(inputs, [folder / name for name in names(objects, request.page)])
    with output_folder(folder):
        readable = _check(models, ignored)
        jobs = [ObjectJob(one, photo, request, readable) for one, photo in zip(objects, photos, strict=True)]
        results = _run(folder, jobs, arguments)
        least = request.least_confidence
        posed = [PosedObject.of(one, result, least) for one, result in zip(objects, results, strict=True)]
        failed = [one for one in posed if not one.figures]
        if len(failed) == len(posed):
            raise ValueError(f"no object has a pose; the first: {_named(failed[0])}")
        for each in failed:
            tell("pose", f"skipped: {_named(each)}")
        write(folder, posed, least, several=len(readable) > 1 and request.method == "best")
    print_table(rows(posed))
    if positions := position_rows(posed):
        print_table(positions)
    if assumed := say_assumed([one.figures for one in posed]):
        say(assumed)
    say_page(folder / "index.html")
    return _status(posed, request, models)


def _read_camera(request: PoseRequest) -> PoseRequest:
    """The request with what its camera's file says in place of the file's name."""
    if request.intrinsics is not None and (request.focal is not None or request.principal_point is not None):
        raise WrongArguments(
            "--intrinsics has focal length and principal point: leave --focal and --principal-point out"
        )
    if not isinstance(request.intrinsics, str):
        return request
    camera = join_distortion(read_camera_file(request.intrinsics), request.distortion)
    return replace(request, intrinsics=camera, distortion=None)


def _run(folder: Path, jobs: list[ObjectJob], arguments: Namespace) -> list[JobResult | str]:
    """The result of each job, or why there is none; a single one is done in this process, and is not stored."""
    if len(jobs) == 1:
        with counter("nablahog pose", "models") as progress:
            return [jobs[0].run(progress)]
    with counter("nablahog pose", "objects") as progress:
        missing = {k: f"{job.photo}: no such file" for k, job in enumerate(jobs) if not job.photo.is_file()}
        there = {k: job for k, job in enumerate(jobs) if k not in missing}
        workers = min(arguments.workers or cores(), max(len(there), 1))
        labels = {k: f"{job.listed.image}, object {job.listed.id}" for k, job in there.items()}
        done = dict(do_all(folder, there, workers=workers, label=labels.__getitem__, progress=progress))
        return [missing[k] if k in missing else done[k] for k in range(len(jobs))]


def _objects(arguments: Namespace) -> tuple[list[AnnotatedObject], list[Path]]:
    """What is known about the objects, and their photographs."""
    photo = Path(arguments.photo)
    if arguments.annotations is None:
        if photo.is_dir():
            raise ValueError(f"{photo}: expected an image file, got a folder, which needs --annotations")
        boxes: list[Box | None] = [Box(*sides) for sides in arguments.box or ()] or [None]
        if arguments.mask is not None and len(boxes) > 1:
            raise WrongArguments("--mask is for one object: expected one --box, or none")
        objects = [AnnotatedObject(k, to_unicode(photo.name), box, arguments.initial) for k, box in enumerate(boxes, 1)]
        return objects, [photo] * len(objects)
    if arguments.box or arguments.initial is not None or arguments.mask is not None:
        raise WrongArguments("--annotations has the boxes and initial poses: expected no --box, --init or --mask")
    check_folder(photo, "the photographs of --annotations")
    objects = read_objects(arguments.annotations, photo)
    return objects, [photo / local_name(one.image) for one in objects]


def _models(request: PoseRequest) -> tuple[list[Model], list[str]]:
    """The models in the folder or file ``request.mesh``, or those of the package; names of files that are none."""
    if request.mesh is None:
        if request.up or request.front:
            raise WrongArguments("--up and --front go with --mesh; the chairs of nablahog need neither")
        return archived_models(SAMPLE_CHAIRS), []
    if request.up is not None:
        with blaming_arguments():
            axes(request.up, request.front)
    path = Path(request.mesh)
    if path.is_dir():
        return read_models(path, up=request.up, front=request.front)
    return [Model(to_unicode(path.stem), path, request.up, request.front)], []


def _check(models: list[Model], ignored: list[str]) -> tuple[Model, ...]:
    """The models that can be read, with progress; a line on stderr for each other, or ValueError if there is none."""
    with counter("nablahog pose", "models") as progress:
        readable, failed = check_models(models, progress)
    for name, reason in (failed | dict.fromkeys(ignored, "its name does not end like that of a model")).items():
        inform(f"nablahog pose: skipped: {name}: {reason}")
    return tuple(readable)


def _status(posed: list[PosedObject], request: PoseRequest, models: list[Model]) -> int:
    """The exit status; says how many poses are doubtful, with advice on the first, and how many are refused."""
    doubtful = [one for one in posed if one.figures.get("warning") is not None]
    if doubtful:
        of_all = "" if len(posed) == 1 else f"{len(doubtful)} of {len(posed)} objects; the first: "
        inform(f"nablahog pose: warning: {of_all}{_explain_warning(doubtful[0], request, models)}")
    least_confidence = request.least_confidence
    refused = sum(one.refused for one in posed)
    if refused:
        which = "the pose is" if len(posed) == 1 else f"{refused} of {len(posed)} poses are"
        inform(
            f"nablahog pose: {which} refused, with a confidence below {least_confidence:g}: the object may be missing, "
            "or unlike the model"
        )
    if not all(one.figures for one in posed):
        return SOME_SKIPPED
    return REFUSED if refused else 0


def _explain_warning(doubtful: PosedObject, request: PoseRequest, models: list[Model]) -> str:
    """The warning of a pose; if it is more likely wrong than right, with what to change, the likeliest cause first."""
    warning: str = doubtful.figures["warning"]
    if not warning.endswith(DOUBT):  # it is about the camera
        return warning
    parts = [warning]
    if doubtful.listed.view is not None and request.within < 180:
        initial = "--init" if request.annotations is None else "the azimuth in --annotations"
        parts.append(
            f"only azimuths within {request.within:g}° of {initial} were searched: check it, or widen --within"
        )
    if doubtful.listed.box is None and not doubtful.listed.polygons and request.mask is None:
        parts.append(
            f"give a rough box of the object {'by --box' if request.annotations is None else 'in --annotations'}"
        )
    if request.mesh and request.up is None and {model.file.suffix.lower() for model in models} - {*Y_UP}:
        parts.append("check the model's axes: if y points up in its file, use --up y --front=+z")
    return "; ".join(parts)


def _named(one: PosedObject) -> str:
    image, reason = one.listed.image, one.failure
    return f"object {one.listed.id}: {reason if image in reason else f'{image}: {reason}'}"


@dataclass(frozen=True)
class ObjectJob:
    """The search for the pose of an object in a photograph."""

    listed: AnnotatedObject
    photo: Path
    request: PoseRequest
    models: tuple[Model, ...]

    @property
    def folder(self) -> str:
        """The name of its folder of stored results."""
        return "poses"

    def files(self) -> list[Path]:
        mask = [] if self.request.mask is None else [Path(self.request.mask)]
        return [self.photo, *mask, *(model.file for model in self.models)]

    def key(self) -> str:
        """A hash of what is known of the object, all files, the options, and the code."""
        facts = {
            "files": [digest(path) for path in self.files()],
            "polygons": self.listed.polygons,
            "named on the page": self.listed.image if self.request.page else None,
            "request": asdict(replace(self._complete(), **_NO_PART_OF_A_RESULT)),
            "models": [model.name for model in self.models],
            "code": code_key(),
        }
        return make_key(facts, np.empty(0, np.float32))

    def fits(self, result: JobResult) -> bool:
        """Whether there are figures and a picture."""
        return len(result.figures) == 1 and result.pictures.shape[1:] == joined_shape(result.figures[0]["drawn_size"])

    @in_plain_mode
    def run(self, progress: Callable[[int, int, str], None] = lambda done, total, what: None) -> JobResult:
        """Finds the pose: its figures, with the page if there is one, and pictures with the outline."""
        request, photo = self._complete(), local_path(self.photo)
        photograph, box = read_image(photo, as_bytes=True), self.listed.box
        size = (photograph.shape[1], photograph.shape[2])
        if request.mask is not None:
            white = read_image(local_path(Path(request.mask))).mean(0) > 0.5
            photograph, box = apply_mask(photograph, as_mask("--mask", white, size), box)
        if self.listed.polygons:
            inside = as_mask("the outline", draw_polygons(self.listed.polygons, *size), size)
            photograph, box = apply_mask(photograph, inside, box)
        lens, given_box = self._lens(photo, size), box
        photograph, box = lens.undistort(photograph), None if box is None else lens.map_box(box)
        meshes = {model.name: model.mesh(local_path(model.file)) for model in self.models}
        known = {"focal": lens.focal, "principal_point": lens.principal_point, "intrinsics": None, "distortion": None}
        began = perf_counter()
        estimate = estimate_pose(photograph, meshes, **request.keywords() | {"box": box} | known, progress=progress)
        seconds = perf_counter() - began
        mesh = meshes[estimate.model]
        figures: dict[str, Any] = {**pose_figures(lens.report(estimate, given_box)), "seconds": round(seconds, 4)}
        figures["drawn_size"] = [*photograph.shape[1:]]
        if request.page:
            figures["page"] = pose_page(self.listed.image, photograph, estimate, meshes, request.method, lens)
        picture = join_pictures(photograph, estimate, mesh)
        return JobResult([figures], np.rint(255 * picture[None]).astype(np.uint8), seconds)

    def _lens(self, photo: Path, size: tuple[int, int]) -> Lens:
        """What the options and the photograph's file say about its camera."""
        asked, exif = self.request, read_exif_focal(photo)
        focal = None if asked.focal == UNKNOWN else asked.focal
        if asked.focal is None and asked.intrinsics is None and exif is not None:
            focal = FROM_FILE
        with naming(photo):
            return choose_lens(size, focal, asked.principal_point, asked.intrinsics, asked.distortion, exif)

    def _complete(self) -> PoseRequest:
        """The request, with what is known about the object."""
        box, initial = self.listed.box, self.listed.view
        within = 180.0 if initial is None else self.request.within
        return replace(self.request, box=None if box is None else (*box,), initial=initial, within=within)
