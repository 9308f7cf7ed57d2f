"""The methods of Table 2.  A new one is one more entry of :data:`POSE_METHODS`, and its name in :mod:`.names`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import torch
from torch import Tensor

from ..hog.box import Box
from ..pose import default_background, estimate_pose
from ..pose.canvas import DISTANCE, cut_out
from ..pose.choices import Search
from ..pose.exemplar import Detection, detect
from ..pose.matching import model_of
from ..pose.placing import place
from ..pose.views import SPEC, Library, Views
from ..render import Camera, Mesh, silhouette


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """An object in an image, to be found in it.

    Attributes:
        image: (C, H, W), C 1 or 3, float32 in 0…1.
        box: of the object in the image.
        models: the candidates by name, at least one; the same objects every time, in the same process.
        initial: azimuth and elevation to begin at, degrees.
    """

    image: Tensor
    box: Box
    models: Mapping[str, Mesh]
    initial: tuple[float, float]


@dataclass(frozen=True)
class Found:
    """The pose found, in the columns of :data:`nablahog.render.PARAMETERS`, of the candidate that fits best.

    Attributes:
        azimuth, elevation, theta: degrees.
        distance: units of the mesh.
        x, y: shift of the principal point, pixels.
        focal: of the camera that these are meant for and that sees the whole image, pixels.
        model: the best candidate's name.
        similarity: to the image.
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
class PoseSettings:
    """What a whole run has in common.

    Attributes:
        seed: of everything random.
        exemplars: a folder to keep the views' elements of models in; where it is makes no difference to what is found.
    """

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
        prepare: what is done once for each model and then kept, so that it takes no time of any object; likewise.
    """

    name: str
    about: str
    run: Callable[[PoseProblem, PoseSettings], Found]
    prepare: Callable[[PoseProblem, PoseSettings], object] | None = None


def coverage(problem: PoseProblem, found: Found) -> Tensor:
    """The share (H, W) of each of the image's pixels that the model covers at the pose found."""
    pose = torch.tensor(
        [[found.azimuth, found.elevation, found.distance, found.theta, found.x, found.y]], dtype=torch.float64
    )
    height, width = problem.image.shape[1:]
    return silhouette(problem.models[found.model], pose, Camera(found.focal, height, width))[0, 0]


def _estimate(problem: PoseProblem, settings: PoseSettings, *, method: Search) -> Found:
    found = estimate_pose(
        problem.image,
        problem.models,
        box=problem.box,
        initial=problem.initial,
        method=method,
        seed=settings.seed,
    )
    return Found(
        azimuth=found.azimuth,
        elevation=found.elevation,
        distance=found.distance,
        theta=found.theta,
        x=found.x,
        y=found.y,
        focal=found.camera.focal,
        model=found.model,
        similarity=found.similarity,
    )


@lru_cache(maxsize=2)
def _library(folder: Path | None) -> Library:
    return Library(folder, default_background(SPEC))


def _views(problem: PoseProblem, settings: PoseSettings) -> dict[str, Views]:
    library = _library(settings.exemplars)
    return {name: library.views(mesh) for name, mesh in problem.models.items()}


def _detect(problem: PoseProblem, settings: PoseSettings) -> Detection:
    return detect(problem.image, problem.box, _views(problem, settings))


def _exemplar(problem: PoseProblem, settings: PoseSettings) -> Found:
    seen = _detect(problem, settings)
    # it has no distance; the object's box says how far away the model would be
    height, width = problem.image.shape[1:]
    canvas = cut_out(problem.image, problem.box)
    start = torch.tensor([[seen.azimuth, seen.elevation, DISTANCE, 0, 0, 0]], dtype=torch.float64)
    placed = place(start, model_of(problem.models[seen.model], canvas.camera).hull, canvas.camera, canvas.size)[0]
    pose, camera = canvas.in_photograph(placed, height, width)
    azimuth, elevation, distance, theta, x, y = pose.tolist()
    return Found(azimuth, elevation, distance, theta, x, y, camera.focal, seen.model, seen.confidence)


def _paper(problem: PoseProblem, settings: PoseSettings) -> Found:
    """From the model and pose that Aubry et al.'s search finds, as in the paper."""
    seen = _detect(problem, settings)
    models = {seen.model: problem.models[seen.model]}
    start = replace(problem, models=models, initial=(seen.azimuth, seen.elevation))
    return _estimate(start, settings, method="paper")


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
            "Compares with renderings of every degree of azimuth at the initial elevation, and takes the most similar.",
            partial(_estimate, method="exhaustive"),
        ),
        PoseMethod(
            "paper",
            "The paper's: momentum over azimuth, every few steps over the distance, too, from the pose that the "
            "baseline finds and 8 azimuths around, with OpenDR's derivatives.",
            _paper,
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
