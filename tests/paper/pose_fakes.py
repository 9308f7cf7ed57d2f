"""Objects whose azimuth is the level of their first pixel, and methods that read it, or fail in some way."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import torch

from nablahog.hog.box import Box
from nablahog.paper.annotations import AnnotatedObject
from nablahog.paper.examples import Examples
from nablahog.paper.models import Model
from nablahog.paper.pose_methods import PoseInput, PoseMethod, PoseOutcome, Table2Settings

MODELS = (Model("chair-01"), Model("chair-02"))


def examples(azimuths: Sequence[float], *, size: int = 16, prefix: str = "") -> Examples:
    objects = []
    for number, azimuth in enumerate(azimuths):
        image = torch.linspace(0.2, 0.8, size * size).reshape(1, size, size)
        image[0, 0, 0] = azimuth / 360
        image[0, 0, 1] = len(prefix) / 100
        box, initial = Box(0.0, 0.0, float(size), float(size)), (90.0 * number, 15.0)
        name = f"{prefix}{number}"
        objects.append(AnnotatedObject(name, image, box, azimuth, 20.0, 1.0, "chair-01", initial, MODELS))
    return Examples(objects, "Made up.")


def _off(problem: PoseInput, settings: Table2Settings, *, by: float) -> PoseOutcome:
    azimuth = float(problem.image[0, 0, 0]) * 360
    assert problem.initial is not None
    elevation = problem.initial[1] + settings.seed
    return PoseOutcome((azimuth + by) % 360, elevation, 3.0, 0.0, 0.0, 0.0, 40.0, list(problem.models)[-1], 0.5)


def _fails_in_front(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    if problem.image[0, 0, 0] == 0:
        raise ValueError("no\nelement")
    return _off(problem, settings, by=100)


def _endless(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    return PoseOutcome(float("inf"), 0, 3, 0, 0, 0, 40, "chair-01", 0)


NEAR = PoseMethod("paper", "Almost right.", partial(_off, by=8.0))
FAR = PoseMethod("exemplar", "Fails in front, and is 100° off elsewhere.", _fails_in_front)
OTHER = PoseMethod("other", "Opposite.", partial(_off, by=180.0))
ENDLESS = PoseMethod("endless", "Nothing finite.", _endless)
