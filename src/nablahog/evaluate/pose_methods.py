"""The methods of Table 2.  A new one is one more entry of :data:`POSE_METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from ..pose import Box, estimate_pose
from ..pose.estimate import Search
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
    """

    seed: int = 0


@dataclass(frozen=True)
class PoseMethod:
    """A method of the table.

    Attributes:
        name: unique.
        about: what it does, a sentence.
        run: depends on nothing but its arguments, and raises ValueError with one sentence where it finds no pose.
            Worker processes import it, so it is a function of a module, or a ``functools.partial`` of one.
    """

    name: str
    about: str
    run: Callable[[PoseProblem, PoseSettings], Found]


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


POSE_METHODS = {
    method.name: method
    for method in (
        PoseMethod(
            "exhaustive",
            "Compares with renderings of every degree of azimuth, and takes the most similar.",
            partial(_estimate, method="exhaustive"),
        ),
        PoseMethod(
            "paper",
            "The paper's: momentum over azimuth, every few steps over the distance, too, from the initial pose and 8 "
            "azimuths around.",
            partial(_estimate, method="paper"),
        ),
        PoseMethod(
            "best",
            "A coarse search over azimuths, and an ascent over all parameters from the best of them.",
            partial(_estimate, method="best"),
        ),
    )
}
"""All methods by name, in the order of the table."""
