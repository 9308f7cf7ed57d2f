"""The work of Table 2: from an object in an image to its pose, by one method."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..hog.box import Box
from ..io.images import as_array
from ..jobs.store import JobResult, key_of
from ..runtime.cache import code_key
from .models import Model
from .pose_methods import PoseInput, PoseMethod, PoseOutcome, Table2Settings, coverage


@dataclass(frozen=True, eq=False)
class PoseJob:
    """One method on one object: a problem, whose image is an array (C, H, W), float32 in 0…1, and the settings."""

    method: PoseMethod
    image: NDArray[np.float32]
    box: Box | None
    models: tuple[Model, ...]
    initial: tuple[float, float] | None
    settings: Table2Settings

    @property
    def name(self) -> str:
        """That of the method."""
        return self.method.name

    def key(self) -> str:
        """A hash of the problem, the method, the settings, and the code that makes the result."""
        facts = {
            "method": self.method.name,
            "box": self.box,
            "models": [[model.name, model.digest()] for model in self.models],
            "initial": self.initial,
            "seed": self.settings.seed,
            "code": code_key(PoseJob, self.method.run, *filter(None, [self.method.prepare])),
        }
        return key_of(facts, self.image)

    def files(self) -> list[Path]:
        """Those of the models."""
        return [model.file for model in self.models if model.file is not None]

    def run(self) -> JobResult:
        """Runs the method: the pose as figures, its silhouette as the picture; the time is without preparation.

        Raises:
            ValueError, OSError: there is no pose, or a model cannot be read.
        """
        meshes = {model.name: model.mesh() for model in self.models}
        problem = PoseInput(torch.from_numpy(self.image), self.box, meshes, self.initial)
        if self.method.prepare is not None:
            self.method.prepare(problem, self.settings)
        began = time.perf_counter()
        outcome = self.method.run(problem, self.settings)
        seconds = time.perf_counter() - began
        figures = asdict(outcome)
        if not all(math.isfinite(value) for value in figures.values() if not isinstance(value, str)):
            raise ValueError(f"the pose is not finite: {figures}")
        silhouette = np.rint(as_array(coverage(problem, outcome)).clip(0, 1) * 255)
        return JobResult([figures], silhouette[None].astype(np.uint8), seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there is a pose, and a silhouette of the image's size."""
        poses = [set(figures) == {field.name for field in fields(PoseOutcome)} for figures in result.figures]
        pictures = result.pictures
        return poses == [True] and pictures.shape == (1, *self.image.shape[1:]) and pictures.dtype == np.uint8
