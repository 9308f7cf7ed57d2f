"""Worker processes: results whatever dies, in one thread each, and none left."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from nablahog.jobs import runner
from nablahog.jobs.runner import cores, run_jobs
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import attempt

from ..paper.common import job
from ..paper.fakes import DARK, KILLED, KILLED_ONCE, MISTAKEN


def test_deaths_and_failures(tmp_path: Path) -> None:
    jobs = [
        job(DARK),
        job(KILLED_ONCE, learned={"prior": tmp_path / "marker"}),
        job(KILLED),
        job(MISTAKEN),
        job(DARK, seed=1),
    ]
    begun: list[int] = []
    output = dict(run_jobs(jobs, workers=1, started=begun.append))
    assert begun == [0, 1, 2, 3, 4, 1, 2]  # what died is tried again in the end
    assert not multiprocessing.active_children()
    for index in (0, 4):
        alone, result = attempt(jobs[index]), output[index]
        assert isinstance(result, JobResult)
        assert isinstance(alone, JobResult)
        assert result.figures == alone.figures
        assert np.array_equal(result.pictures, alone.pictures)
    assert output[2] == "the process at work on it died, 2 times, the last time by signal SIGKILL"
    assert isinstance(output[1], JobResult)
    assert output[1].figures[0]["distance"] == 1  # its number of threads
    assert str(output[3]).startswith("KeyError at fakes.py:")


def test_left_early() -> None:
    with closing(run_jobs([job(DARK, seed=seed) for seed in range(3)], workers=1)) as outcomes:
        next(outcomes)
        assert len(multiprocessing.active_children()) == 1
    assert not multiprocessing.active_children()


def test_workers_that_do_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "serve", sys.exit)
    with pytest.raises(ChildProcessError, match=r"end before they have started \(exit status 1\)"):
        dict(run_jobs([job(DARK)], workers=2))
    assert not multiprocessing.active_children()


def test_nothing_to_do() -> None:
    assert list(run_jobs([], workers=2)) == []


def test_the_parent_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with runner.one_thread(), runner._no_interrupts():
        assert os.environ["OMP_NUM_THREADS"] == "1"
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert "OMP_NUM_THREADS" not in os.environ
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_cores() -> None:
    assert 1 <= cores() <= (os.cpu_count() or 1)
