"""``nablahog pose``: the pose of one object in a photograph."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from ...io.files import output_folder
from ...io.images import read_image
from ...pose.crop import FILL, SIDE, checked_box, crop_object
from ...pose.estimate import estimate_pose
from ...pose.mask import masked
from ...pose.prepared import ELEMENT, PreparedPhotograph
from ...pose.whitening import Background
from ..errors import REFUSED, UserError, as_user_error, forbid_overwrite
from ..inputs.lens import LensOptions
from ..inputs.models import find_models, read_meshes
from ..inputs.viewpoint_prior import viewpoint_choice
from ..results.pose_page import result_names, write
from ..results.pose_result import PoseResult
from ..terminal import counter, inform, print_table, say_page
from .pose_list import pose_list


def pose(arguments: Namespace) -> int:
    """Finds the pose of an object; writes its figures, pictures and page.

    Several objects, of ``arguments.box`` or ``annotations``, are those of :func:`.pose_list.pose_list`.

    Returns:
        The exit status: 0, or :data:`~nablahog.cli.errors.REFUSED` if the confidence is below what was asked for.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    if arguments.photo is None and arguments.annotations is None:
        raise UserError("expected a photograph, or a list of objects: --annotations")
    if arguments.annotations is not None or len(arguments.box or ()) > 1:
        return pose_list(arguments)
    with as_user_error():
        photograph = read_image(arguments.photo)
        height, width = photograph.shape[1:]
        box = None if arguments.box is None else checked_box(arguments.box[0], height, width)
        if arguments.mask is not None:
            photograph, box = masked(photograph, read_image(arguments.mask).mean(0) > 0.5, box)
        lens = LensOptions.of(arguments).lens(arguments.photo, height, width)
        background = None if arguments.background is None else _background(Path(arguments.background))
        viewpoints = viewpoint_choice(arguments.viewpoint_prior and Path(arguments.viewpoint_prior))
        models = find_models(arguments)
    folder = Path(arguments.output)
    files = arguments.background, arguments.viewpoint_prior, arguments.mask
    inputs = [arguments.photo, *filter(None, files), *models.paths.values()]
    forbid_overwrite(inputs, [folder / name for name in result_names(arguments.photo)])
    with output_folder(folder), as_user_error():
        meshes = read_meshes(models, arguments)
        with counter("nablahog pose") as progress:
            began = time.perf_counter()
            estimate = estimate_pose(
                photograph,
                meshes,
                box=box,
                initial=arguments.init,
                within=arguments.within,
                focal=lens.focal,
                principal_point=lens.principal_point,
                method=arguments.method,
                similarity=arguments.similarity,
                background=background,
                viewpoints=viewpoints,
                seed=arguments.seed,
                progress=progress,
            )
        estimate = replace(estimate, focal_from=lens.source)
        known = estimate.camera.focal, estimate.principal_point
        result = PoseResult(
            photo=arguments.photo,
            photograph=photograph,
            box=estimate.box,
            matched=PreparedPhotograph(crop_object(photograph, estimate.box, SIDE, FILL, *known), background),
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
            viewpoint_prior=arguments.viewpoint_prior,
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
