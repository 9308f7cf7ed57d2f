"""``nablahog pose``: the pose of one object in a photograph."""

from __future__ import annotations

import json
import os
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from ...datasets.cad import Models, read_models
from ...datasets.chairs import library
from ...io.files import output_folder
from ...io.images import read_image
from ...pose.crop import SIDE, checked_box, crop_object
from ...pose.estimate import estimate_pose
from ...pose.prepared import ELEMENT, PreparedPhotograph
from ...pose.whitening import Background
from ...render import Camera, Mesh
from ...render.axes import axes
from ..errors import REFUSED, as_user_error, forbid_overwrite
from ..results.pose_page import result_names, write
from ..results.pose_result import PoseResult
from ..terminal import counter, inform, print_table, say_page

Progress = Callable[[int, int, str], None]


def pose(arguments: Namespace) -> int:
    """Finds the pose; writes its figures, pictures and page.

    Returns:
        The exit status: 0, or :data:`~nablahog.cli.errors.REFUSED` if the confidence is below what was asked for.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        photograph = read_image(arguments.photo)
        height, width = photograph.shape[1:]
        box = None if arguments.box is None else checked_box(arguments.box, height, width)
        background = None if arguments.background is None else _background(Path(arguments.background))
        models = Models({}, []) if arguments.mesh is None else _models(Path(arguments.mesh))
        if arguments.mesh is None and (arguments.up or arguments.front):
            raise ValueError("--up and --front say how the files of --mesh lie; the chairs of nablahog need neither")
        if arguments.up is not None:
            axes(arguments.up, arguments.front)
    folder = Path(arguments.output)
    inputs = [arguments.photo, arguments.background or arguments.photo, *models.paths.values()]
    forbid_overwrite(inputs, [folder / name for name in result_names(arguments.photo)])
    with output_folder(folder), as_user_error():
        with counter("nablahog pose") as progress:
            meshes = library() if arguments.mesh is None else _meshes(models, arguments, progress)
        for name, reason in (*models.failed.items(), *((name, "no model by its ending") for name in models.ignored)):
            inform(f"nablahog pose: skipped: {name}: {reason}")
        with counter("nablahog pose") as progress:
            began = time.perf_counter()
            estimate = estimate_pose(
                photograph,
                meshes,
                box=box,
                initial=arguments.init,
                within=arguments.within,
                focal=_focal(arguments, height, width),
                method=arguments.method,
                similarity=arguments.similarity,
                background=background,
                seed=arguments.seed,
                progress=progress,
            )
        result = PoseResult(
            photo=arguments.photo,
            photograph=photograph,
            box=estimate.box,
            matched=PreparedPhotograph(crop_object(photograph, estimate.box, focal=estimate.camera.focal), background),
            estimate=estimate,
            mesh=meshes[estimate.model],
            models=arguments.mesh,
            candidates=list(meshes),
            passed_over=models.failed,
            seconds=time.perf_counter() - began,
            method=arguments.method,
            initial=arguments.init,
            seed=arguments.seed,
            background=arguments.background,
            least_confidence=arguments.least_confidence,
        )
        write(folder, result)
    if result.warning is not None:
        inform(f"nablahog pose: warning: {result.warning}")
    if arguments.json:
        print(json.dumps(result.figures(), indent=2, allow_nan=False))
    else:
        print_table([result.row()])
        say_page(folder / "index.html")
    if result.refusal is not None:
        inform(f"nablahog pose: refused: {result.refusal}")
    return 0 if result.refusal is None else REFUSED


def _focal(arguments: Namespace, height: int, width: int) -> float | None:
    """Pixels, if one of the two options says it."""
    if arguments.field_of_view is not None:
        return Camera.from_field_of_view(arguments.field_of_view, height, width).focal
    focal: float | None = arguments.focal
    return focal


def _background(path: Path) -> Background:
    background = Background.load(path)
    rows, cols = background.spec.grid(SIDE, SIDE)
    if background.order + 1 < max(ELEMENT) or rows < ELEMENT[0] or cols < ELEMENT[1]:
        raise ValueError(
            f"{path}: expected a background that knows visual elements of {ELEMENT[0]}x{ELEMENT[1]} cells in pictures "
            f"of {SIDE}x{SIDE} pixels, got one of order {background.order} with cells of "
            f"{background.spec.cell_size[0]}x{background.spec.cell_size[1]}"
        )
    return background


def _models(path: Path) -> Models:
    """The models of a folder, or the one of a file."""
    if path.is_dir():
        return read_models(path)
    return Models({os.fsencode(path.stem).decode(errors="backslashreplace"): path}, [])


def _meshes(models: Models, arguments: Namespace, progress: Progress) -> dict[str, Mesh]:
    meshes = {}
    for name, mesh in models.meshes(arguments.up, arguments.front):
        meshes[name] = mesh
        progress(len(meshes) + len(models.failed), len(models.paths), f"reading {name}")
    if not meshes:
        name, reason = next(iter(models.failed.items()))
        first = "no model can be read; the first: " if len(models.paths) > 1 else ""
        raise ValueError(f"{first}{models.paths[name]}: {reason}")
    return meshes
