"""Jobs in this process and in others: figures or one sentence, whatever process dies; in one thread each; none left."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from nablahog.io.files import replacing
from nablahog.jobs import processes, runner
from nablahog.jobs.runner import map_on, run_jobs
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import DIED, attempt, cores
from nablahog.paper.methods import ReconstructionMethod
from nablahog.paper.table1 import ReconstructionJob

from ..paper.common import ThisProcess, job
from ..paper.fakes import DARK, HUNGRY, KILLED, KILLED_ONCE, MISTAKEN, SILENT


@pytest.mark.parametrize(
    ("method", "reason"),
    [(HUNGRY, "not enough memory"), (SILENT, "TypeError at table1.py:"), (MISTAKEN, "KeyError at fakes.py:")],
)
def test_reasons(method: ReconstructionMethod, reason: str) -> None:
    assert str(attempt(job(method))).startswith(reason)


def check_as_alone(job: ReconstructionJob, result: JobResult | str) -> None:
    """Checks the result of a job in another process against that in this one."""
    alone = attempt(job)
    assert isinstance(result, JobResult)
    assert isinstance(alone, JobResult)
    assert result.figures == alone.figures
    assert np.array_equal(result.pictures, alone.pictures)


@pytest.mark.slow
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
        check_as_alone(jobs[index], output[index])
    assert output[2] == DIED
    assert isinstance(output[1], JobResult)
    assert output[1].figures[0]["distance"] == 1  # its number of threads
    assert str(output[3]).startswith("KeyError at fakes.py:")


@pytest.mark.slow
def test_a_death_beside_others() -> None:
    """Jobs at work when a process dies are done all the same."""
    output = dict(run_jobs([job(KILLED), *(job(DARK, seed=seed) for seed in range(3))], workers=2))
    assert output.pop(0) == DIED
    assert len(output) == 3
    assert all(isinstance(result, JobResult) for result in output.values())


@pytest.mark.slow
def test_left_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """No worker is left, and the parent is as before."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with closing(run_jobs([job(DARK, seed=seed) for seed in range(3)], workers=1)) as outcomes:
        next(outcomes)
        assert len(multiprocessing.active_children()) == 1
    assert not multiprocessing.active_children()
    assert "OMP_NUM_THREADS" not in os.environ
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_workers_that_do_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "begin", sys.exit)
    with pytest.raises(ChildProcessError, match="end before they have started"):
        dict(run_jobs([job(DARK)], workers=2))
    assert not multiprocessing.active_children()


def test_a_map_is_in_order_and_raises_why_a_call_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "open_executor", lambda *_: nullcontext(ThisProcess(lambda job: None)))
    assert list(map_on("a cluster")(int, ["1", "2", "3"])) == [1, 2, 3]
    with pytest.raises(ValueError, match="invalid literal"):
        list(map_on("a cluster")(int, ["1", "x", "3"]))


def test_cores(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("nablahog.jobs.worker.CGROUP", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    assert cores() == 64
    (tmp_path / "cpu").mkdir()  # version 1 of control groups
    for quota, expected in (("-1", 64), ("150000", 2), ("1", 1)):
        (tmp_path / "cpu" / "cpu.cfs_quota_us").write_text(quota)
        (tmp_path / "cpu" / "cpu.cfs_period_us").write_text("100000\n")
        assert cores() == expected
    for written, expected in (("max 100000\n", 64), ("250000 100000\n", 3)):
        (tmp_path / "cpu.max").write_text(written)
        assert cores() == expected


_PARENT = """
import threading, time
from multiprocessing import active_children
from nablahog.jobs.runner import run_jobs

def tell():
    while not active_children():
        time.sleep(0.001)
    print("started", flush=True)

threading.Thread(target=tell).start()
list(run_jobs([time.sleep] * 100, workers=2))
"""


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 0.3, 0.9])
def test_a_parent_that_is_killed_while_workers_start(seconds: float) -> None:
    with subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "started\n"
        time.sleep(seconds)
        parent.kill()
        parent.communicate(timeout=2)  # until the last process that has inherited the pipe has ended


_WRITING_PARENT = """
from nablahog.jobs.runner import run_jobs
from tests.jobs.test_runner import SlowWriting

list(run_jobs([SlowWriting(name) for name in ("a", "b")], workers=2))
"""


@dataclass(frozen=True)
class SlowWriting:
    """Writes a file that is never whole."""

    name: str

    def run(self) -> None:
        with replacing(self.name) as file:
            while True:
                file.write(b"half")
                file.flush()
                time.sleep(0.001)


@pytest.mark.slow
def test_workers_of_a_parent_that_is_killed_remove_what_they_were_writing(tmp_path: Path) -> None:
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    with subprocess.Popen([sys.executable, "-c", _WRITING_PARENT], cwd=tmp_path, env=paths) as parent:
        while sum(path.stat().st_size > 0 for path in tmp_path.glob("*.part")) < 2:
            assert parent.poll() is None
            time.sleep(0.01)
        parent.kill()
    latest = time.monotonic() + 5
    while os.listdir(tmp_path) and time.monotonic() < latest:
        time.sleep(0.01)
    assert not os.listdir(tmp_path)


def test_workers_load_nothing_before_they_watch_their_parent() -> None:
    program = "import sys, nablahog.jobs.worker; print(*({'torch', 'numpy', 'scipy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "\n"
