"""The methods of Table 2.  A new one is one more entry of :data:`POSE_METHODS`, and its name in :mod:`.names`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import torch
from torch import Tensor

from ..inputs.boxes import Box
from ..jobs.worker import local_folder
from ..pose import default_background, estimate_pose
from ..pose.crop import crop_object
from ..pose.model import fit_to_box, level_poses, prepared_model
from ..pose.options import SearchMethod
from ..render import Camera, Mesh, silhouette
from .baselines.exemplar import Detection, detect
from .baselines.exemplar_views import EXEMPLAR_SPEC, ExemplarLibrary, ExemplarViews


@dataclass(frozen=True, eq=False)
class PoseInput:
    """What a method is given: the box of an object in an image (C, H, W), float32 in 0…1, and candidate models by name.

    ``initial`` is the azimuth and elevation to begin at, degrees.  It and the box are None where they are not known.
    """

    image: Tensor
    box: Box | None
    models: Mapping[str, Mesh]
    initial: tuple[float, float] | None


@dataclass(frozen=True)
class PoseOutcome:
    """A method's pose (:data:`nablahog.render.PARAMETERS`), and its best candidate with the similarity to the image.

    The focal length, in pixels, is that of a camera that sees the whole image.
    """

    azimuth: float
    elevation: float
    distance: float
    theta: float
    x: float
    y: float
    focal: float
    model: str
    similarity: float


@dataclass(frozen=True)
class Table2Settings:
    """The settings of a whole run: a seed, and a folder to store the elements of models in, which changes no pose."""

    seed: int = 0
    exemplars: Path | None = None


@dataclass(frozen=True)
class PoseMethod:
    """A method of the table.

    Attributes:
        name: unique.
        about: what it does, a sentence.
        run: depends on nothing but its arguments, and raises ValueError with one sentence where it finds no pose.
            Worker processes import it, so it is a function of a module, or a ``functools.partial`` of one.
        prepare: work done once for each model and cached, which is not part of an object's time; called as ``run``.
    """

    name: str
    about: str
    run: Callable[[PoseInput, Table2Settings], PoseOutcome]
    prepare: Callable[[PoseInput, Table2Settings], object] | None = None


def coverage(problem: PoseInput, outcome: PoseOutcome) -> Tensor:
    """The share (H, W) of each of the image's pixels that the model covers at its pose."""
    values = outcome.azimuth, outcome.elevation, outcome.distance, outcome.theta, outcome.x, outcome.y
    pose = torch.tensor([values], dtype=torch.float64)
    height, width = problem.image.shape[1:]
    return silhouette(problem.models[outcome.model], pose, Camera(outcome.focal, height, width))[0, 0]


def _estimate(problem: PoseInput, settings: Table2Settings, *, method: SearchMethod) -> PoseOutcome:
    estimate = estimate_pose(
        problem.image,
        problem.models,
        box=problem.box,
        initial=problem.initial,
        method=method,
        seed=settings.seed,
    )
    return _outcome(estimate.pose[0], estimate.camera, estimate.model, estimate.similarity)


def _outcome(pose: Tensor, camera: Camera, model: str, similarity: float) -> PoseOutcome:
    azimuth, elevation, distance, theta, x, y = pose.tolist()
    return PoseOutcome(azimuth, elevation, distance, theta, x, y, camera.focal, model, similarity)


@lru_cache(maxsize=2)
def _library(folder: Path | None) -> ExemplarLibrary:
    return ExemplarLibrary(folder, default_background(EXEMPLAR_SPEC))


def _views(problem: PoseInput, settings: Table2Settings) -> dict[str, ExemplarViews]:
    library = _library(settings.exemplars and local_folder(settings.exemplars))
    return {name: library.views(mesh) for name, mesh in problem.models.items()}


def detection(problem: PoseInput, settings: Table2Settings) -> Detection:
    """Aubry et al.'s most confident detection, with its model; in the whole image where no box is known."""
    height, width = problem.image.shape[1:]
    return detect(problem.image, problem.box or Box(0.0, 0.0, width, height), _views(problem, settings))


def _exemplar(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    detected = detection(problem, settings)
    # a detection has no distance; it follows from the size of the object's box
    height, width = problem.image.shape[1:]
    crop = crop_object(problem.image, problem.box)
    start = level_poses(torch.tensor([detected.azimuth], dtype=torch.float64), detected.elevation)
    model = prepared_model(problem.models[detected.model])
    placed = fit_to_box(start, model.hull, crop.camera, crop.size)[0]
    pose, camera = crop.place_in_photograph(placed, height, width)
    return _outcome(pose, camera, detected.model, detected.confidence)


def _paper(problem: PoseInput, settings: Table2Settings, *, method: SearchMethod) -> PoseOutcome:
    """From the model and pose of Aubry et al.'s most confident detection, as in the paper."""
    detected = detection(problem, settings)
    models = {detected.model: problem.models[detected.model]}
    start = replace(problem, models=models, initial=(detected.azimuth, detected.elevation))
    return _estimate(start, settings, method=method)


POSE_METHODS = {
    method.name: method
    for method in (
        PoseMethod(
            "exemplar",
            "The baseline of Aubry et al.: detects renderings of all candidates by their discriminative elements, and "
            "takes the viewpoint of the most confident detection whose box is the object's.",
            _exemplar,
            _views,
        ),
        PoseMethod(
            "exhaustive",
            "Compares with renderings of every degree of azimuth at the initial elevation, or at eight if it is "
            "unknown, and takes the most similar.",
            partial(_estimate, method="exhaustive"),
        ),
        PoseMethod(
            "paper",
            "The paper's: dot products of ∇HOG descriptors of patches, momentum over azimuth, every few steps over the "
            "distance, too, from the pose that the baseline finds and 8 azimuths around, with OpenDR's derivatives.",
            partial(_paper, method="paper"),
            _views,
        ),
        PoseMethod(
            "paper-edges",
            "The same with the derivative of the area that edges cover, and 2x2 samples a pixel.",
            partial(_paper, method="paper-edges"),
            _views,
        ),
        PoseMethod(
            "best",
            "A coarse search over azimuths, and an ascent over all parameters from the best of them.",
            partial(_estimate, method="best"),
        ),
    )
}
"""All methods by name, in the order of the table."""
