"""Methods that are fast, or fail in some way; worker processes import them from here."""

from __future__ import annotations

import os
import signal
from functools import partial

import torch
from torch import Tensor

from nablahog.paper.methods import Method, MethodOutput, Table1Settings
from nablahog.paper.names import DALAL, UOCTTI


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


DARK = Method("dark", UOCTTI, partial(_shifted, by=-0.25))
BRIGHT = Method("uoctti-single", UOCTTI, partial(_shifted, by=0.25))
LEVELS = Method("dalal-multi-scale", DALAL, _levels, multiscale=True)
UNDEFINED = Method("undefined", DALAL, _undefined)
MISTAKEN = Method("mistaken", DALAL, _mistaken)
HUNGRY = Method("hungry", DALAL, _hungry)
SILENT = Method("silent", DALAL, _silent)
KILLED = Method("killed", DALAL, _killed)
KILLED_ONCE = Method("killed-once", DALAL, _killed_once)
