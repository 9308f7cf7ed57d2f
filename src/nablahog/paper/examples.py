"""What Table 2 is made from: objects in images, their true viewpoints, and the models to choose among."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..io.images import Picture
from .annotations import AnnotatedObject
from .conditions import CONDITIONS, PLAIN
from .models import Meshes, Model

PHOTOGRAPHED_FROM = 15.0  # degrees of elevation: about the median of the chairs that PASCAL3D+ is trained on, 16°


@dataclass
class Examples:
    """Objects to estimate the pose of.

    Attributes:
        objects: in order.
        origin: where they are from, whole sentences.
        failed: why an image could not be read, by its name.
    """

    objects: list[AnnotatedObject]
    origin: str
    failed: Mapping[str, str] = field(default_factory=dict)


def photographed(
    objects: Sequence[AnnotatedObject],
    models: Sequence[Model],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
    condition: str = "",
    failed: Mapping[str, str] | None = None,
) -> Examples:
    """Objects in photographs, whose candidates are all ``models``, or all but their own.

    The initial pose does not depend on the truth: azimuths are random, and the elevation is
    :data:`PHOTOGRAPHED_FROM` for all.

    Args:
        objects: with a true viewpoint, and the name of their own model or of the one most like them.
        models: the candidates.
        origin: where the objects are from, whole sentences.
        unknown_model: whether to leave an object's own model out.
        seed: of the initial azimuths, and of the condition.
        condition: one of :data:`~nablahog.paper.conditions.CONDITIONS` that photographs can have; none if empty.
        failed: why an image could not be read, by its name.

    Raises:
        ValueError: an object has no candidate.
    """
    examples = []
    for index, each in enumerate(objects):
        candidates = tuple(model for model in models if not (unknown_model and model.name == each.model))
        if not candidates:
            raise ValueError(f"{each.name}: there is no candidate model")
        initial = (random_azimuth(seed, each.name), PHOTOGRAPHED_FROM)
        one = replace(each, initial=initial, candidates=candidates)
        if condition:
            one = replace(CONDITIONS[condition].applied(one, seed, index), name=f"{condition}/{one.name}")
        examples.append(one)
    among = f"{len(models)} models{' but its own, or the one most like it' if unknown_model else ''}"
    start = f"from a random azimuth and {PHOTOGRAPHED_FROM:g}° of elevation"
    return Examples(examples, f"{origin} Each is looked for by all of {among}, {start}.", failed or {})


def rendered(
    count: int,
    models: Sequence[Model],
    viewpoints: NDArray[np.float64],
    photographs: Sequence[Picture],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
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
        condition: one of :data:`~nablahog.paper.conditions.CONDITIONS`; none if empty.

    Raises:
        ValueError: there is no candidate.
    """
    if unknown_model and len(models) < 2:
        raise ValueError(f"an unknown model needs at least 2 models to leave one out, got {len(models)}")
    meshes, scenes = Meshes(models), CONDITIONS[condition] if condition else PLAIN
    objects = []
    for index in range(count):
        one = scenes.scene(index, meshes, viewpoints, photographs, seed=seed)
        candidates = tuple(model for model in models if (model.name == one.model) != unknown_model)
        name = f"{condition}/{one.name}" if condition else one.name
        objects.append(replace(one, name=name, candidates=candidates))
    by = "all models but its own" if unknown_model else "its own model"
    start = "from a random azimuth and an elevation near the true one"
    return Examples(objects, f"{count} scenes of {origin}. Each object is looked for by {by}, {start}.")


def random_azimuth(seed: int, name: str) -> float:
    """An azimuth in 0…360 that depends on the seed and the object only, not on how many others there are."""
    return float(np.random.default_rng([seed, zlib.crc32(name.encode())]).uniform(0, 360))
