"""The job of Table 1: one image, to its descriptor and back, by one method."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .. import metrics
from ..io.images import as_array
from ..jobs.store import JobResult, digest, key_of
from ..runtime.cache import code_key
from .methods import Method, MethodOutput, Table1Settings

Figures: TypeAlias = dict[str, float | None]  # by metric; None where one is not defined


@dataclass(frozen=True)
class ReconstructionJob:
    """One method on one image, (H, W) float32 in 0…1."""

    method: Method
    image: NDArray[np.float32]
    settings: Table1Settings

    @property
    def name(self) -> str:
        """The name of the method."""
        return self.method.name

    def key(self) -> str:
        """A hash of image, method, settings, and the code that makes the result."""
        settings, method = self.settings, self.method
        facts = {
            "method": method.name,
            "rows": method.rows,
            "spec": None if method.spec is None else method.spec.to_json(),
            "seed": settings.seed,
            "max_evaluations": settings.max_evaluations,
            "learned": [digest(path) for path in self.files()],
            "code": code_key(ReconstructionJob, method.run),
        }
        return key_of(facts, self.image)

    def files(self) -> list[Path]:
        """The learned files that it reads."""
        return [self.settings.learned[kind] for kind in self.method.needs if kind in self.settings.learned]

    def run(self) -> JobResult:
        """Runs the method and compares its outputs with the image: figures and a picture for each of its rows.

        Raises:
            ValueError: the method cannot take the image.
        """
        began = time.perf_counter()
        outputs = self.method.run(torch.from_numpy(self.image)[None, None], self.settings)
        seconds = time.perf_counter() - began
        if len(outputs) != len(self.method.rows):
            raise TypeError(f"expected one output for each of {', '.join(self.method.rows)}, got {len(outputs)}")
        figures = [_figures(one, self.image) for one in outputs]
        return JobResult(figures, np.stack([_levels(one.image) for one in outputs]), seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there are figures and a picture of the image's size for each row."""
        rows, pictures = len(self.method.rows), result.pictures
        whole = pictures.shape == (rows, *self.image.shape) and pictures.dtype == np.uint8
        return whole and len(result.figures) == rows


def _figures(output: MethodOutput, reference: NDArray[np.float32]) -> Figures:
    pair = output.image.detach(), reference
    cc = metrics.cross_correlation(*pair)
    figures = {
        "cc": cc,
        "abs_cc": abs(cc),
        "mi": metrics.mutual_information(*pair),
        "ssim": metrics.ssim(*pair),
        "psnr": metrics.psnr(*pair),
        "distance": output.distance,
    }
    # JSON knows no NaN and no infinity
    return {name: value if np.isfinite(value) else None for name, value in figures.items()}


def _levels(image: Tensor) -> NDArray[np.uint8]:
    return np.rint(as_array(image) * 255).astype(np.uint8)
