"""What the tests of the table share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import torch
from skimage import data
from torch import Tensor

from nablahog import HOGSpec, LearnedPrior
from nablahog.invert.learned import network_class
from nablahog.invert.prior_network import Architecture
from nablahog.invert.provenance import NetworkLearning
from nablahog.io.learned_model import count_weights
from nablahog.io.photographs import Photographs
from nablahog.jobs.store import Job, JobResult
from nablahog.jobs.worker import attempt
from nablahog.paper.methods import Method, Table1Settings
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


def job(method: Method, **settings: object) -> ReconstructionJob:
    return ReconstructionJob(method, image().numpy(), Table1Settings(**settings))  # type: ignore[arg-type]


def here(
    jobs: Sequence[Job], *, workers: int, started: Callable[[int], None] = lambda index: None
) -> Iterator[tuple[int, JobResult | str]]:
    """Stands in for ``run_jobs`` where no process is needed; finishes in another order than it begins."""
    for index in reversed(range(len(jobs))):
        started(index)
        yield index, attempt(jobs[index])


def made(folder: Path, of: Photographs, *methods: Method, seed: int = 0) -> Table1:
    return run_table1(folder, of, methods, Table1Settings(seed), workers=1)
