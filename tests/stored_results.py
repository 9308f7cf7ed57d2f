"""Short searches for images, searches for poses and short trainings, and what they come to, as numbers.

``python -m tests.stored_results`` writes ``stored_results.json``.  Nobody knows from elsewhere what these numbers must
be: they say that a result has changed, not which one is right.  Whoever changes one says why.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

import nablahog
from nablahog.hog.dialects import as_spec
from nablahog.invert import AsPublished, Reconstruction, Search, reconstruct_template
from nablahog.invert.prior.signed_network import Architecture
from nablahog.invert.scales import level_spec
from nablahog.pose import estimate_pose
from nablahog.pose.detection import find_boxes
from nablahog.pose.model import prepared_model
from nablahog.render import Mesh

from .chairs import chair
from .hog.zoo import noise
from .invert.photographs import photograph
from .pose.common import SWIVEL, model, photographed

STORED = Path(__file__).with_suffix(".json")
SIZE = 40, 48
PHOTOGRAPH = photograph(48).double()[:, :, : SIZE[0]]
SHORT = Search(max_evaluations=40)
PLACES = 8  # pixels of an image that are stored


def read(result: Reconstruction[Tensor]) -> list[float]:
    """The distance, the evaluations, the deviation and some pixels of a result."""
    pixels = result.image.flatten()
    some = pixels[torch.linspace(0, len(pixels) - 1, PLACES).long()]
    return [float(result.distance[0]), float(result.evaluations[0]), float(pixels.std()), *some.tolist()]


def invert(spec: str, **options: Any) -> list[float]:
    return read(nablahog.reconstruct(nablahog.hog(PHOTOGRAPH, spec), spec, SIZE, **options))


def invert_levels(spec: str) -> list[float]:
    descriptor = nablahog.hog(PHOTOGRAPH, spec)
    levels = nablahog.reconstruct_multiscale(descriptor, spec, SIZE, scales=(4, 1), prior=None, search=SHORT)
    return read(levels[-1].reconstruction)


def invert_levels_of_their_own(spec: str) -> list[float]:
    """A descriptor of each level, as of a shrunk photograph."""
    small, _ = level_spec(as_spec(spec), 4, SIZE)
    descriptors = [nablahog.hog(avg_pool2d(PHOTOGRAPH, 2), small), nablahog.hog(PHOTOGRAPH, spec)]
    levels = nablahog.reconstruct_multiscale(descriptors, spec, SIZE, scales=(4, 1), prior=None, search=SHORT)
    return read(levels[-1].reconstruction)


def invert_template(spec: str) -> list[float]:
    weights = noise(*nablahog.hog(PHOTOGRAPH, spec).shape) - 0.5
    return read(reconstruct_template(weights, spec, SIZE, max_evaluations=40))


def estimate(models: Mesh | dict[str, Mesh], *, known_box: bool = True, **options: Any) -> list[float]:
    """The pose of a chair, what its confidence rests on, and the best pose from another side."""
    image, box = photographed(model(), 35, 18, behind="coffee")
    found = estimate_pose(image, models, box=box if known_box else None, **options)
    numbers = [found.azimuth, found.elevation, found.distance, found.similarity]
    if found.confidence is not None and found.evidence is not None:
        evidence, other = found.evidence, found.runners_up[0]
        numbers += [found.confidence, evidence.sidelobe, evidence.agreement, evidence.in_range, evidence.upright]
        numbers += [other.azimuth, other.similarity, other.share]
    return numbers


def detect(*models: Mesh) -> list[float]:
    """The sides of the boxes where the models may be."""
    image, _ = photographed(model(), 35, 18, behind="coffee")
    boxes = find_boxes(image, [prepared_model(mesh) for mesh in models], None, 180.0, None)
    return [side for box in boxes for side in box]


def train(spec: str) -> list[float]:
    """The losses of two epochs."""
    images = {name: photograph(64, name)[0, 0, : SIZE[0]] for name in ("camera", "coins", "clock", "brick")}
    tiny = Architecture((8, 8, 8), (1, 0, 0))
    return [*nablahog.train_prior(images, spec, epochs=2, architecture=tiny, precision="float32").learning.losses]


SEARCHES: dict[str, Callable[[], list[float]]] = {
    **{
        f"{spec} without a prior": partial(invert, spec, prior=None, search=Search(max_evaluations=60))
        for spec in ("uoctti", "dalal_triggs", "skimage", "paper")
    },
    "as published": partial(invert, "paper", method=AsPublished(iterations=1)),
    "levels": partial(invert_levels, "uoctti"),
    "levels of their own": partial(invert_levels_of_their_own, "uoctti"),
    "template": partial(invert_template, "dlib"),
    "unsigned template": partial(invert_template, "dalal_triggs"),
}
# the networks of priors are in float32, whose rounding grows
SEARCHES_WITH_PRIOR: dict[str, Callable[[], list[float]]] = {
    spec: partial(invert, spec, search=SHORT) for spec in ("uoctti", "dalal_triggs")
}
POSES: dict[str, Callable[[], list[float]]] = {
    "pose": lambda: estimate(model()),
    "pose without a box": lambda: estimate(model(), known_box=False),
    "pose of a lens": lambda: estimate(model(), focal=300.0),
    "pose within 60°": lambda: estimate(model(), initial=(60, 15), within=60),
    "pose among models": lambda: estimate({"first": chair(7), "second": model(SWIVEL), "third": chair(9)}),
    "boxes": lambda: detect(model()),
    "boxes of two models": lambda: detect(model(SWIVEL), chair(7)),
    "exhaustive pose": lambda: estimate(model(), initial=(60, 15), method="exhaustive"),
}
TRAININGS: dict[str, Callable[[], list[float]]] = {
    "signed training": partial(train, "uoctti"),
    "unsigned training": partial(train, "paper"),
}


if __name__ == "__main__":
    results = {**SEARCHES, **SEARCHES_WITH_PRIOR, **POSES, **TRAININGS}
    found = {name: [float(f"{number:.6g}") for number in compute()] for name, compute in results.items()}
    lines = (f"{json.dumps(name)}: {json.dumps(numbers)}" for name, numbers in found.items())
    STORED.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
