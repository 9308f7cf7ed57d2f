"""What Table 2 is made from: objects in images, their true viewpoints, and the models to choose among."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ..hog.box import Box
from ..io.images import Picture
from .annotations import AnnotatedPhotograph
from .conditions import CONDITIONS, Case
from .models import Meshes, Model
from .pascal3d import Selection

PHOTOGRAPHED_FROM = 15.0  # degrees of elevation: about the median of the chairs that PASCAL3D+ is trained on, 16°


@dataclass(frozen=True, eq=False)
class Example:
    """An object in an image.

    Attributes:
        name: unique.
        image: (C, H, W), C 1 or 3, float32 in 0…1.
        box: of the object in the image; None if methods are not given any.
        azimuth, elevation, theta: the true ones, degrees.
        model: the name of its own model, or of the one most like it; None if there is none.
        models: the candidates, at least one.
        initial: azimuth and elevation that methods may begin at, degrees; None if they are not given any.
    """

    name: str
    image: Tensor
    box: Box | None
    azimuth: float
    elevation: float
    theta: float
    model: str | None
    models: tuple[Model, ...]
    initial: tuple[float, float] | None


@dataclass
class Examples:
    """Objects to estimate the pose of.

    Attributes:
        objects: in order.
        origin: where they are from, whole sentences.
        failed: why an image could not be read, by its name.
    """

    objects: list[Example]
    origin: str
    failed: dict[str, str] = field(default_factory=dict)


def photographed(selection: Selection, models: Sequence[Model], *, unknown_model: bool, seed: int) -> Examples:
    """Objects of PASCAL3D+, whose candidates are all ``models``, or all but the one annotated as most like it.

    The initial pose does not depend on the truth: the initial azimuths are random, and the initial elevation is
    :data:`PHOTOGRAPHED_FROM` for all.

    Args:
        selection: the objects.
        models: the candidates, those of PASCAL3D+ by the names of their files, as "03".
        unknown_model: whether to leave the annotated one out.
        seed: of the initial azimuths.

    Raises:
        ValueError: an object has no candidate.
    """
    objects = []
    for each in selection.objects:
        candidates = tuple(model for model in models if not (unknown_model and model.name == each.cad))
        if not candidates:
            raise ValueError(f"{each.name}: there is no candidate model")
        height, width = each.image.shape[1:]
        initial = (random_azimuth(seed, each.name), PHOTOGRAPHED_FROM)
        truth = each.viewpoint.azimuth, each.viewpoint.elevation, each.viewpoint.theta
        box = Box(0.0, 0.0, float(width), float(height))
        objects.append(Example(each.name, each.image, box, *truth, each.cad, candidates, initial))
    among = f"{len(models)} models{' but the one annotated as most like it' if unknown_model else ''}"
    origin = (
        f"PASCAL VOC with the viewpoints of PASCAL3D+: {selection.summary()} Each object is looked for by all of "
        f"{among}, from a random azimuth and {PHOTOGRAPHED_FROM:g}° of elevation."
    )
    return Examples(objects, origin, selection.failed)


def annotated(
    photographs: Sequence[AnnotatedPhotograph],
    models: Sequence[Model],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
    condition: str = "",
) -> Examples:
    """Objects in annotated photographs, whose candidates are all ``models``, or all but their own.

    Initial poses are those of :func:`photographed`.

    Args:
        photographs: the objects.
        models: the candidates.
        origin: of the photographs and models: the middle of a sentence.
        unknown_model: whether to leave an object's own model out.
        seed: of the initial azimuths, and of the condition.
        condition: one of :data:`~nablahog.paper.conditions.CONDITIONS` that photographs can have; none if empty.

    Raises:
        ValueError: an object has no candidate.
    """
    objects = []
    for index, each in enumerate(photographs):
        candidates = tuple(model for model in models if not (unknown_model and model.name == each.model))
        if not candidates:
            raise ValueError(f"{each.name}: there is no candidate model")
        case = Case(each.image, each.box, (random_azimuth(seed, each.name), PHOTOGRAPHED_FROM))
        if condition:
            case = CONDITIONS[condition].case(case, seed, index)
        truth = each.azimuth, each.elevation, each.theta
        name = _named(each.name, condition)
        objects.append(Example(name, case.image, case.box, *truth, each.model, candidates, case.initial))
    among = f"{len(models)} models{' but its own' if unknown_model else ''}"
    given = f"from a random azimuth and {PHOTOGRAPHED_FROM:g}° of elevation"
    return Examples(objects, f"{len(objects)} objects of {origin}. Each is looked for by all of {among}, {given}.")


def rendered(
    count: int,
    models: Sequence[Model],
    viewpoints: NDArray[np.float64],
    photographs: Sequence[Picture],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
    candidates: Sequence[Model] | None = None,
    condition: str = "",
) -> Examples:
    """Scenes of models in front of photographs, whose candidate is their own model, or all others.

    The initial pose is that of the scene: a random azimuth, an elevation near the truth.

    Args:
        count: scenes, at least 1.
        models: of which each scene shows one.
        viewpoints: (N, 3), as :func:`~nablahog.paper.viewpoints.read_viewpoints`, of which each scene has one.
        photographs: the clutter, as :func:`~nablahog.paper.scenes.scene` takes it.
        origin: of the models, viewpoints and photographs: the middle of a sentence.
        unknown_model: whether to leave the scene's own model out, and search with all others.
        seed: of the scenes.
        candidates: to search among instead, for all scenes.
        condition: one of :data:`~nablahog.paper.conditions.CONDITIONS`; none if empty.

    Raises:
        ValueError: there is no candidate.
    """
    if unknown_model and len(models) < 2:
        raise ValueError(f"an unknown model needs at least 2 models to leave one out, got {len(models)}")
    meshes = Meshes(models)
    scenes = CONDITIONS[condition or "as-table2"]
    objects = []
    for index in range(count):
        case, made = scenes.scene(index, meshes, viewpoints, photographs, seed=seed)
        own = [model for model in models if (model.name == made.model) != unknown_model]
        truth = float(made.pose[0]), float(made.pose[1]), float(made.pose[3])
        among = tuple(own if candidates is None else candidates)
        name = _named(f"{index:04d}", condition)
        objects.append(Example(name, case.image, case.box, *truth, made.model, among, case.initial))
    by = "all models but its own" if unknown_model else "its own model"
    if candidates is not None:
        by = f"{len(candidates)} other models"
    given = "from a random azimuth and an elevation near the true one"
    return Examples(objects, f"{count} scenes of {origin}. Each object is looked for by {by}, {given}.")


def _named(name: str, condition: str) -> str:
    """Names of objects are unique in all conditions."""
    return f"{condition}/{name}" if condition else name


def random_azimuth(seed: int, name: str) -> float:
    """An azimuth in 0…360 that depends on the seed and the object only, not on how many others there are."""
    return float(np.random.default_rng([seed, zlib.crc32(name.encode())]).uniform(0, 360))
