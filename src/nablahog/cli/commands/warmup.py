"""``nablahog warmup``: compiles all loops ahead of their first use, as into the image of a container."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Sequence

import numpy as np
import torch
from torch.autograd import forward_ad

from ...compat.opencv import HOGDescriptor
from ...datasets import chairs
from ...hog import HOGSpec, hog
from ...invert import reconstruct
from ...pose import estimate_pose
from ...runtime.forward_mode import load_forward_mode
from ...runtime.machine_code import code_folder
from ...runtime.processor import levels
from ..arguments.did_you_mean import did_you_mean
from ..arguments.preset_parameters import PRESETS, window_of
from ..arguments.warmup import STEPS
from ..errors import UserError
from ..terminal import counter, say

SIDE = 64


def warmup(arguments: Namespace) -> None:
    """Compiles what each of ``arguments.steps`` needs, all without any.

    Raises:
        UserError: there is no such step, or no folder to keep machine code in; the log has the reasons.
        SystemExit: a process of ``--portable`` failed, and has said why.
    """
    steps = arguments.steps or STEPS
    for step in steps:
        if step not in STEPS:
            raise UserError(f"expected steps of {', '.join(STEPS)}, got {step!r}{did_you_mean(step, STEPS)}")
    folder = code_folder()
    if folder is None:
        raise UserError("there is no folder to keep machine code in: set NABLAHOG_CACHE_DIR to one that you may write")
    if arguments.portable:
        return _portable(steps)
    began, before = time.monotonic(), _files()
    with counter("nablahog warmup") as progress:
        for done, step in enumerate(steps):
            progress(done, len(steps), step)
            _run(step)
    say(f"{_files() - before} functions compiled in {time.monotonic() - began:.0f} s, kept in {folder}")


def _portable(steps: Sequence[str]) -> None:
    """The same in a process for each level: numba reads what it compiles for when it is loaded."""
    if not levels():
        raise UserError("this processor has no level that others share: leave out --portable")
    for general in levels():
        say(f"for processors of level {general.name}")
        command = [sys.executable, "-m", "nablahog", "warmup", *steps]
        ended = subprocess.run(command, env=os.environ | general.environment(), check=False)
        if ended.returncode:
            raise SystemExit(ended.returncode)


def _files() -> int:
    folder = code_folder()
    return sum(1 for _ in folder.glob("*.code")) if folder else 0


def _run(step: str) -> None:
    """A small example of a step."""
    if step == "reconstruct":
        for preset in ("paper", "uoctti"):
            spec = PRESETS[preset]()
            reconstruct(hog(torch.rand(1, 1, SIDE, SIDE), spec), spec, (SIDE, SIDE), quality="fast")
    elif step == "pose":
        estimate_pose(torch.rand(1, SIDE, SIDE), chairs.chair(0), initial=(0.0, 20.0))
    else:
        _describe(PRESETS[step](), window_of(step, {}) or (SIDE, SIDE))
    if step == "opencv":
        _detect()


def _describe(spec: HOGSpec, size: tuple[int, int]) -> None:
    """Images of both dtypes, and their derivatives in both modes."""
    load_forward_mode()
    for dtype in (torch.float32, torch.float64):
        images = torch.rand(1, 1 if spec.colour == "gray" else 3, *size, dtype=dtype, requires_grad=True)
        torch.autograd.grad(hog(images, spec).sum(), images)
        with forward_ad.dual_level():
            hog(forward_ad.make_dual(images.detach(), torch.ones_like(images)), spec)  # type: ignore[no-untyped-call]


def _detect() -> None:
    """OpenCV's own class: descriptors, windows and their scores."""
    descriptor = HOGDescriptor()
    descriptor.setSVMDetector(np.zeros(descriptor.getDescriptorSize() + 1, np.float32))
    descriptor.detectMultiScale(np.zeros((160, 80, 3), np.uint8))
