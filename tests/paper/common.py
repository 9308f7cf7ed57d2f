"""What the tests of the table share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from skimage import data
from torch import Tensor

from nablahog import HOGSpec, LearnedPrior
from nablahog.invert.prior.learned import network_class
from nablahog.invert.prior.provenance import NetworkLearning
from nablahog.invert.prior.signed_network import Architecture
from nablahog.io.learned_model import count_weights
from nablahog.io.photographs import Photographs
from nablahog.jobs import runner
from nablahog.jobs.worker import attempt
from nablahog.paper.methods import ReconstructionMethod, Table1Settings
from nablahog.paper.table1 import ReconstructionJob, Table1, run_table1


def photographs(count: int = 3, size: int = 32) -> Photographs:
    """Squares of one photograph."""
    camera = torch.from_numpy(data.camera() / 255).float()[::4, ::4]
    return Photographs({f"{k}.png": camera[:size, 20 * k : 20 * k + size].contiguous() for k in range(count)})


def image() -> Tensor:
    return photographs(1).images["0.png"]


def write_prior(path: Path, spec: HOGSpec, *, images: Sequence[str] = (), value: float = 0.1) -> Path:
    """A prior for cells of 8 that has learned nothing."""
    tiny = Architecture((4, 4, 4), (0, 0, 0))
    weights = torch.full((count_weights(lambda: network_class(spec)(tiny)),), value, dtype=torch.float16)
    learning = NetworkLearning(images=tuple(images), sha256="00", seed=0, epochs=1, losses=(1.0,))
    LearnedPrior(spec, tiny, weights, learning).save(path)
    return path


def job(method: ReconstructionMethod, **settings: object) -> ReconstructionJob:
    return ReconstructionJob(method, image().numpy(), Table1Settings(**settings))  # type: ignore[arg-type]


class ThisProcess:
    """An executor where no process is needed; jobs end in another order than they begin, each is given to ``begin``."""

    def __init__(self, begin: Callable[[Any], None]) -> None:
        self.begin, self.most = begin, math.inf
        self.at_work: dict[int, Any] = {}

    def has_room(self) -> bool:
        return len(self.at_work) < self.most

    def submit(self, index: int, job: Any, left: int) -> None:
        self.begin(job)
        self.at_work[index] = job

    def next_outcome(self) -> tuple[int, Any]:
        index, job = self.at_work.popitem()
        return index, attempt(job)

    def close(self) -> None:
        pass


def run_in_this_process(monkeypatch: pytest.MonkeyPatch, begin: Callable[[Any], None] = lambda job: None) -> None:
    """Jobs are done in this process."""
    monkeypatch.setattr(runner, "Processes", lambda workers: ThisProcess(begin))


def made(folder: Path, of: Photographs, *methods: ReconstructionMethod, seed: int = 0) -> Table1:
    return run_table1(folder, of, methods, Table1Settings(seed), workers=1)
