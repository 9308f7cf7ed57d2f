"""What else is public: models that are learned, and what others are made of."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import torch

import nablahog
from nablahog import invert, pose
from nablahog.io import StoredDescriptor
from nablahog.render import Light

from ..table import Use, column
from .plain import BATCH, CAMERA, DESCRIPTOR, MESH, POSES, SIZE, SMALL, angle, image, number, size

SPEC = nablahog.presets.aubry(4, colour="gray")


@lru_cache
def background() -> pose.Background:
    return pose.learn_background({"a": BATCH[0, 0]}, SPEC, order=2)


def elements(d: Any, cells: Any = (2, 2), count: Any = 3) -> Any:
    return pose.elements(d, background(), cells, count=count, threshold=0.0).patches


def stored(d: Any, image_size: Any = SIZE) -> Any:
    result = StoredDescriptor(d, nablahog.presets.uoctti(), image_size)
    return result.descriptor, result.image_size


COLUMNS = [
    column(
        "scale_descriptors",
        batch=Use(lambda x: invert.scale_descriptors(x, "uoctti", (4, 1)), SMALL),
        number=number(lambda n: invert.scale_descriptors(SMALL, "uoctti", [n]), 4),
        types=(torch.Tensor,),
    ),
    column(
        "StoredDescriptor",
        descriptor=Use(stored, DESCRIPTOR[0]),
        size=size(lambda s: stored(DESCRIPTOR[0], s)),
        types=(torch.Tensor,),
    ),
    column(
        "Light",
        angle=angle(lambda a: nablahog.render(MESH, POSES, CAMERA, light=Light(ambient=a, diffuse=0.0)), 1.0),
    ),
    column(
        "elements",
        descriptor=Use(elements, nablahog.hog(BATCH[:1], SPEC)[0]),
        size=size(lambda s: elements(nablahog.hog(BATCH[:1], SPEC)[0], s), (2, 2)),
        number=number(lambda n: elements(nablahog.hog(BATCH[:1], SPEC)[0], count=n), 3),
        tolerance=5e-3,
        types=(torch.Tensor,),
    ),
    column(
        "learn_background",
        image=image(lambda x: pose.learn_background({"a": x}, SPEC, order=2).mean),
        number=number(lambda n: pose.learn_background({"a": BATCH[0, 0]}, SPEC, order=n).covariance, 2),
        angle=angle(lambda a: replace(background(), regularization=a).regularization, 1.0),
        tolerance=1e-4,
    ),
]
