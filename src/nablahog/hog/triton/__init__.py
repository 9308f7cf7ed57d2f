"""The operator's steps in Triton, for GPUs: the same results up to rounding, and the same derivatives.

``docs/kernels.md`` explains them; ``tests/hog/triton`` compares them with the reference steps.  Triton is loaded when
images on a GPU come, not before.
"""

from __future__ import annotations

import os
from functools import cache
from importlib.util import find_spec
from typing import Any

import torch

from ...runtime.advice import warn_caller
from ...runtime.extras import INSTALL_COMMANDS

LEAST_CAPABILITY = 7, 0
"""The oldest GPUs that Triton compiles for."""


def interpreted() -> bool:
    """Whether kernels are run by Triton's interpreter, on a CPU, for tests."""
    return os.environ.get("TRITON_INTERPRET") == "1"


@cache
def _any_gpu() -> bool:
    return torch.cuda.is_available()


@cache
def _missing(device: torch.device) -> str:
    """Why there are no kernels for a device; nothing if there are."""
    if find_spec("triton") is None:
        return f"Triton is not installed: {INSTALL_COMMANDS['gpu']}"
    if device.type == "cuda" and torch.version.hip is None:
        capability = torch.cuda.get_device_capability(device)
        if capability < LEAST_CAPABILITY:
            return f"Triton has no code for GPUs of compute capability {capability[0]}.{capability[1]}"
    return ""


@cache
def _say_once(why: str) -> None:
    warn_caller(f"hog runs in plain PyTorch on this GPU, which takes some forty times the image's memory. {why}")


def _traceable(cached: Any) -> Any:
    """The function behind a cache while ``torch.compile`` traces, because it warns of caches."""
    return cached.__wrapped__ if torch.compiler.is_compiling() else cached


def chosen(device: torch.device) -> bool:
    """Whether ``backend="auto"`` takes the kernels; if they are missing it says so, once."""
    if device.type != "cuda" or not _traceable(_any_gpu)():
        return False
    why = _traceable(_missing)(device)
    if why and not torch.compiler.is_compiling():  # who calls is not known there
        _say_once(why)
    return not why


def check(device: torch.device) -> None:
    """Raises if ``backend="triton"`` cannot be taken.

    Raises:
        ValueError: the images are not on a GPU.
        ModuleNotFoundError: Triton is not installed, or has no code for the GPU.
    """
    if device.type != "cuda" and not (interpreted() and device.type == "cpu"):
        raise ValueError(f"the backend 'triton' computes on a GPU, got images on the device {device.type!r}")
    if why := _traceable(_missing)(device):
        raise ModuleNotFoundError(f"the backend 'triton' cannot be used: {why}")
