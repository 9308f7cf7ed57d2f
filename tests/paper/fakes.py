"""Methods of both tables that are fast, or fail in some way; worker processes import them from here."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from functools import partial

import torch
from torch import Tensor

from nablahog.inputs.boxes import Box
from nablahog.paper.annotations import Example
from nablahog.paper.examples import Examples
from nablahog.paper.methods import MethodOutput, ReconstructionMethod, Table1Settings
from nablahog.paper.names import DALAL, UOCTTI
from nablahog.paper.pose_methods import PoseInput, PoseMethod, PoseOutcome, Table2Settings
from nablahog.paper.scenes import CHAIRS
from nablahog.render.models import Model


def _shifted(image: Tensor, settings: Table1Settings, *, by: float) -> list[MethodOutput]:
    return [MethodOutput((image[0, 0] + by * (settings.seed + 1)).clamp(0, 1), by)]


def _levels(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    if image.shape[2] % 8:
        raise ValueError("no scale\n1/64")
    return [MethodOutput(image[0, 0] * k / 4, k / 4) for k in (4, 1, 2, 3, 4)]


def _undefined(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    return [MethodOutput(image[0, 0], float("inf"))]


def _mistaken(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    raise KeyError("oh")


def _hungry(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    raise RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate much")


def _silent(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    return []


def _killed(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    os.kill(os.getpid(), signal.SIGKILL)
    return []


def _killed_once(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    marker = settings.learned["prior"]  # stands in for memory: what it lacks the first time is there the second time
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return [MethodOutput(image[0, 0], torch.get_num_threads())]


DARK = ReconstructionMethod("dark", UOCTTI, partial(_shifted, by=-0.25))
BRIGHT = ReconstructionMethod("uoctti-single", UOCTTI, partial(_shifted, by=0.25))
LEVELS = ReconstructionMethod("dalal-multi-scale", DALAL, _levels, multiscale=True)
UNDEFINED = ReconstructionMethod("undefined", DALAL, _undefined)
MISTAKEN = ReconstructionMethod("mistaken", DALAL, _mistaken)
HUNGRY = ReconstructionMethod("hungry", DALAL, _hungry)
SILENT = ReconstructionMethod("silent", DALAL, _silent)
KILLED = ReconstructionMethod("killed", DALAL, _killed)
KILLED_ONCE = ReconstructionMethod("killed-once", DALAL, _killed_once)

# --- objects of Table 2, whose azimuth is the level of their first pixel, and methods that read it

MODELS = (Model("chair-01", CHAIRS), Model("chair-02", CHAIRS))


def examples(azimuths: Sequence[float], *, size: int = 16, prefix: str = "") -> Examples:
    objects = []
    for number, azimuth in enumerate(azimuths):
        image = torch.linspace(0.2, 0.8, size * size).reshape(1, size, size)
        image[0, 0, 0] = azimuth / 360
        image[0, 0, 1] = len(prefix) / 100
        box, initial = Box(0.0, 0.0, float(size), float(size)), (90.0 * number, 15.0)
        name = f"{prefix}{number}"
        objects.append(Example(name, image, box, azimuth, 20.0, 1.0, "chair-01", initial, MODELS))
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
