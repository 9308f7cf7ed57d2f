"""A process that forks before each command, so that PyTorch is loaded once; table jobs are done in the fork."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from nablahog.cli.commands import hog, learn, table1, table2  # noqa: F401, loaded once
from nablahog.cli.main import main
from nablahog.hog import kernels  # noqa: F401, loaded once
from nablahog.jobs import resume
from nablahog.jobs.runner import run_jobs
from nablahog.jobs.store import Job, JobResult
from nablahog.jobs.worker import attempt
from nablahog.paper import pose_job
from nablahog.paper.baselines import hoggles_learning
from nablahog.paper.learned import LEARNED
from nablahog.paper.pose_methods import POSE_METHODS, PoseInput, PoseMethod, PoseOutcome, Table2Settings


def _here(
    jobs: Sequence[Job], *, workers: int, started: Callable[[int], None]
) -> Iterator[tuple[int, JobResult | str]]:
    """One worker is this process; more are processes as always."""
    if workers > 1:
        yield from run_jobs(jobs, workers=workers, started=started)
        return
    for index, job in enumerate(jobs):
        started(index)
        yield index, attempt(job)


def _guess(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    return PoseOutcome(*(problem.initial or (0.0, 0.0)), 3.0, 0.0, 0.0, 0.0, 100.0, ",".join(problem.models), 0.5)


def _covered(problem: PoseInput, outcome: PoseOutcome) -> Tensor:
    return torch.ones(problem.image.shape[1:])


def _small() -> None:
    """Learning and poses take no time."""
    hoggles_learning.REPORTED = 2  # type: ignore[misc]
    learner = LEARNED["hoggles"]
    LEARNED["hoggles"] = replace(learner, learn=partial(learner.learn, atoms=20, iterations=9))
    for name, method in list(POSE_METHODS.items()):
        POSE_METHODS[name] = PoseMethod(name, method.about, _guess)
    pose_job.coverage = _covered  # type: ignore[assignment]
    resume.run_jobs = _here  # type: ignore[assignment]


def serve() -> None:
    """Reads a folder and the arguments of a command from each line; answers its process, and its status at the end."""
    torch.set_num_threads(1)
    _small()
    for line in sys.stdin:
        folder, *command = line[:-1].split("\t")
        child = os.fork()
        if not child:
            _run(folder, command)
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _run(folder: str, command: Sequence[str]) -> None:
    status = 99
    try:
        os.chdir(folder)
        output = os.open("printed", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        status = main(command)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)
