"""estimate_pose(): from an object in a photograph and models of it to azimuth, elevation and distance (Section 3.2).

:data:`SEARCHES` has the searches by name.  Here are the paper's, gradient ascent with momentum over azimuth, and the
exhaustive one that it is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..inputs.arrays import ArrayImage, as_mask, as_photograph, warn_about_levels
from ..inputs.boxes import Box
from ..inputs.cameras import advise_on_size, as_view
from ..inputs.numbers import as_number, as_seed, check_callable, check_choice
from ..inputs.pil_images import is_pil
from ..io.images import exif_focal
from ..io.input_file import Readable
from ..render import Mesh
from ..render.mesh import check_mesh
from ..render.renderer import EdgeMethod
from ..runtime.advice import warn_caller
from ..runtime.pytorch import in_plain_mode
from .ascent import SearchTrace, momentum_ascent
from .best_search import best_search
from .crop import SMALLEST_SIDE, apply_mask, check_box, crop_object
from .detection import find_boxes
from .lens import choose_lens
from .model import DETAIL, equidistant_azimuths, prepared_model
from .options import SearchMethod, SimilarityKind
from .photograph import PreparedPhotograph
from .problem import ELEVATIONS, PoseProblem
from .result import PoseEstimate
from .viewpoint_prior import ViewpointChoice, choose_viewpoints
from .whitening import Background

EVERY_DEGREE = 360
PAPER_STARTS = 8  # azimuths all around, beside the initial one
# a normalised model may have been changed: the largest diagonal of its bounding box, or 1 over the smallest, and the
# farthest that its middle may be from the origin
_LARGEST_DIAGONAL, _FARTHEST_MIDDLE = 2.0, 0.1
RENDERERS: dict[SearchMethod, tuple[EdgeMethod, int]] = {"paper": ("opendr", 1), "paper-edges": ("edges", 2)}
"""How the paper's methods differentiate renderings, and with how many samples along the side of a pixel."""


def paper_search(problem: PoseProblem, *, method: SearchMethod) -> PoseEstimate:
    """Ascent with momentum from the initial pose and azimuths all around, by the renderer of a method of the paper."""
    template = problem.photograph.template(problem.similarity)
    azimuth, elevation = problem.initial or (0.0, ELEVATIONS[1])
    azimuths = torch.cat([equidistant_azimuths(1, azimuth), equidistant_azimuths(PAPER_STARTS)])
    best, traces, renderings = [], [], 0
    for name, model in problem.iterate_models():
        similarity = model.similarity(template, *RENDERERS[method], camera=problem.photograph.crop.camera)
        starts = problem.level_views(model, azimuths, elevation)
        poses, values, path = momentum_ascent(similarity, starts, visit=partial(problem.watch, name))
        top = int(values.argmax())
        best.append((float(values[top]), name, poses[top]))
        traces += [
            SearchTrace(name, tuple(trace[:, 0].tolist()), tuple(trace[:, 1].tolist())) for trace in path.unbind(1)
        ]
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda found: found[0])
    return problem.estimate(name, pose, similarity=value, renderings=renderings, traces=tuple(traces))


def exhaustive_search(problem: PoseProblem) -> PoseEstimate:
    """The best of all whole degrees of azimuth at the initial elevation, or at several if that is unknown."""
    template = problem.photograph.template(problem.similarity)
    best, renderings = [], 0
    for name, model in problem.iterate_models():
        similarity = model.similarity(template, detail=DETAIL, camera=problem.photograph.crop.camera)
        for elevation in ELEVATIONS if problem.initial is None else problem.initial[1:]:
            poses = problem.level_views(model, equidistant_azimuths(EVERY_DEGREE), elevation)
            values = similarity.values(poses)
            top = int(values.argmax())
            best.append((float(values[top]), name, poses[top]))
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda found: found[0])
    return problem.estimate(name, pose, similarity=value, renderings=renderings)


SEARCHES: dict[SearchMethod, Callable[[PoseProblem], PoseEstimate]] = {
    "best": best_search,
    "paper": partial(paper_search, method="paper"),
    "paper-edges": partial(paper_search, method="paper-edges"),
    "exhaustive": exhaustive_search,
}


@in_plain_mode
def estimate_pose(
    photograph: Tensor | ArrayImage,
    models: Mesh | Mapping[str, Mesh] | Sequence[Mesh],
    *,
    box: Sequence[float] | None = None,
    mask: Tensor | NDArray[np.bool_] | None = None,
    initial: Sequence[float] | None = None,
    within: float = 180.0,
    focal: float | Sequence[float] | NDArray[Any] | Tensor | Literal["exif"] | None = None,
    principal_point: Sequence[float] | None = None,
    intrinsics: Sequence[float]
    | Sequence[Sequence[float]]
    | NDArray[Any]
    | Tensor
    | Mapping[str, Any]
    | Readable
    | None = None,
    distortion: Sequence[float] | NDArray[Any] | Tensor | None = None,
    method: SearchMethod = "best",
    similarity: SimilarityKind | None = None,
    background: Background | None = None,
    viewpoints: ViewpointChoice = "default",
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    watch: Callable[[str, Tensor], None] = lambda model, pose: None,
) -> PoseEstimate:
    """The pose at which a rendering of a model has the HOG most like the photograph's (Section 3.2).

    The object is cropped and described.  A search then renders the models at poses whose descriptors agree with it
    better and better.

    Args:
        photograph: (C, H, W), float32 or float64 in 0…1, or uint8, one channel or R, G, B; or an array (H, W) or
            (H, W, C), or a PIL image.
        models: meshes by name, a list of them, whose names are "0", "1" and so on, or one mesh, whose name is that of
            its file; all are tried, the best is returned.  They are normalised as by :func:`nablahog.load_mesh`, about
            a unit in size and around the origin.  Without models of your own, ``nablahog.sample_chairs()`` has chairs
            of all common kinds.
        box: x0, y0, x1, y1 of the object, pixels; by default the object may be anywhere.  ``"best"`` with the
            calibrated similarity searches around it, so it may be rough or cut off.  All others take the box as it is,
            by default the whole photograph.
        mask: (H, W), bool, true where the object is; the rest of the photograph is ignored.  The box may be left out.
        initial: azimuth and elevation to begin at, degrees, of an object that is nearly upright; by default unknown.
            ``"best"`` searches elevations 15° below and above, too, prefers those near it, and ascends freely, so that
            a rough one does no harm; the other methods stay at it.
        within: how far the azimuth may be from the initial one, degrees, for ``"best"`` only.  By default all azimuths
            are searched, and the initial one has no influence.
        focal: focal length of the photograph's camera, pixels; (fx, fy); or its camera matrix (3, 3), which gives the
            principal point, too.  Then the distance is the true one.  ``"exif"`` takes it from the EXIF data of a PIL
            image, as :func:`nablahog.io.images.read_exif_focal`.  By default an object that fills its box is assumed to
            be three of its diagonals away.
        principal_point: x, y where the optical axis of a camera of known focal length meets the photograph, pixels; by
            default its middle.  Objects far from it look stretched, which the search takes into account.
        intrinsics: the camera matrix (3, 3), or fx, fy, cx, cy, pixels, in place of ``focal`` and ``principal_point``;
            or the file of a camera, see :func:`nablahog.io.camera_file.read_camera_file`, with its distortion; or a
            dict with the names of its JSON.
        distortion: OpenCV's k1, k2, p1, p2 and maybe k3, of a camera of known focal length.  The photograph is then
            undistorted, and so it is, to square pixels, where fx and fy differ: the pose is for the ideal camera, see
            :class:`PoseEstimate`, while the box and the mask belong to the photograph as it is.
        method: ``"best"``: views all around at three elevations about the initial one (or at eight, if unknown), then
            an ascent over all six parameters from the best of them, at last with smaller cells.  ``"paper"``: patches
            of the photograph's visual elements, OpenDR's derivatives, momentum over azimuth and every few steps over
            distance, from the initial pose and 8 azimuths around.  ``"paper-edges"``: the same with the renderer's
            derivative of the area that edges cover.  ``"exhaustive"``: every degree of azimuth at the initial
            elevation.
        similarity: ``"patches"`` or ``"calibrated"``, see :mod:`.similarity`; by default ``"patches"``
            for the paper's methods and ``"calibrated"`` for the others.
        background: of the coarse descriptor, which also says which descriptor that is; by default that of
            :func:`.background.pose_spec`, learned from photographs that come with scikit-image.
        viewpoints: a prior that says from which side an object is seen, for ``"best"`` among several models, see
            :mod:`.vote`; it counts only if it knows the class of the models.  By default the one for
            chairs that comes with the package; None for none.
        seed: of the random samples of ``"best"``; the other methods have none.
        progress: called with the models done, their number and the name of the one at work; after the last one, with
            what remains to be done.
        watch: called with the name of a model and each pose (6,) that the search comes to, for the object's crop, see
            :func:`.crop.crop_object`.  An exception that it raises ends the search.

    Returns:
        The pose for the photograph, with its camera.  The distance depends on the camera's focal length, which is
        hard to tell from one photograph.

    Raises:
        TypeError: the photograph is no tensor, array or PIL image, or a model is no mesh.
        ValueError: the photograph, the box, a model or an option is none of the above.

    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> photograph = nablahog.render(mesh, torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]
    >>> box = (28, 12, 95, 125)  # x0, y0, x1, y1

    >>> estimate = nablahog.estimate_pose(photograph, mesh, box=box, initial=(0, 20), method="exhaustive")
    >>> 25 < estimate.azimuth < 35
    True
    """
    if isinstance(models, list | tuple):
        models = {str(number): mesh for number, mesh in enumerate(models)}
    named = models if isinstance(models, Mapping) else {getattr(models, "name", ""): models}
    meshes = {name: _check_normalized(name, check_mesh(mesh)).detach() for name, mesh in named.items()}
    if not meshes:
        raise ValueError("expected at least one model, got none")
    check_choice("method", method, SearchMethod)
    if similarity is not None:
        check_choice("similarity", similarity, SimilarityKind)
    within = as_number("within", within, above=0, most=180)
    if within < 180 and initial is None:
        raise ValueError(f"`within` {within:g} needs `initial`, the azimuth from which it is measured")
    if within < 180 and method != "best":
        raise ValueError(f"`within` is for `method` 'best' alone, got {within:g} for {method!r}")
    check_callable("progress", progress, "done, total, what")
    check_callable("watch", watch, "model, pose")
    kind = similarity or ("patches" if method in RENDERERS else "calibrated")
    image, view = as_photograph("the photograph", photograph), None if initial is None else as_view("initial", initial)
    if min(image.shape[1:]) < SMALLEST_SIDE:
        raise ValueError(
            f"the photograph must have at least {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels, got "
            f"{image.shape[1]}x{image.shape[2]} (height x width)"
        )
    warn_about_levels(image)
    exif = exif_focal(photograph) if isinstance(focal, str) and is_pil(photograph) else None  # type: ignore[arg-type]
    lens = choose_lens((image.shape[1], image.shape[2]), focal, principal_point, intrinsics, distortion, exif)
    camera = lens.camera
    if camera is not None and principal_point is None:
        advice = advise_on_size(camera.height, camera.width, camera.cx, camera.cy)
        if advice is not None:
            warn_caller(advice)
    generator = torch.Generator().manual_seed(as_seed(seed))
    box = None if box is None else check_box(box, image.shape[1], image.shape[2])  # in the photograph's pixels
    if mask is not None:
        image, box = apply_mask(image, as_mask("the mask", mask, (image.shape[1], image.shape[2])), box)
    given_box = box
    image, box = lens.undistort(image), None if box is None else lens.map_box(box)
    whole = Box(0.0, 0.0, float(image.shape[2]), float(image.shape[1]))
    prepared = {name: prepared_model(mesh) for name, mesh in meshes.items()}
    other_boxes: tuple[Box, ...] | None = None
    if box is None and method == "best" and kind == "calibrated":
        box, *rest = *find_boxes(image, list(prepared.values()), view, within, background), whole
        other_boxes = tuple(rest)
    crop = crop_object(image, whole if box is None else box, focal=lens.focal, axis=lens.principal_point)
    problem = PoseProblem(
        image,
        PreparedPhotograph(crop, background),
        box=whole if box is None else box,
        other_boxes=other_boxes,
        models=prepared,
        initial=view,
        within=within,
        similarity=kind,
        # do not read a default that has no influence
        viewpoints=choose_viewpoints(viewpoints) if viewpoints != "default" or len(meshes) > 1 else None,
        generator=generator,
        progress=progress,
        watch=watch,
    )
    return lens.report(SEARCHES[method](problem), given_box)


def _check_normalized(name: str, mesh: Mesh) -> Mesh:
    """``mesh``; ValueError if its bounding box is not about one with a diagonal of 1 around the origin."""
    low, high = (corner.double() for corner in (mesh.vertices.detach().amin(0), mesh.vertices.detach().amax(0)))
    diagonal, off = float((high - low).norm()), float(((low + high) / 2).norm())
    if not (1 / _LARGEST_DIAGONAL <= diagonal <= _LARGEST_DIAGONAL and off <= _FARTHEST_MIDDLE):
        what = f"the model {name!r}" if name else "the model"
        raise ValueError(
            f"{what} must have a bounding box with a diagonal of 1 around the origin, got one of {diagonal:.3g}, "
            f"{off:.3g} off: write mesh.normalized()"
        )
    return mesh
