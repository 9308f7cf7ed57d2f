"""Jobs on a Dask cluster: results whatever process dies, and one sentence where there is no cluster."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import pytest
from distributed import LocalCluster

from nablahog.jobs.runner import run_jobs
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import DIED, local_path, store_files

from ..paper.common import job
from ..paper.fakes import DARK, KILLED, MISTAKEN
from .test_runner import check_as_alone

pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask's own sockets
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a cluster of one worker, in processes of its own."""
    folder = tmp_path_factory.mktemp("dask")
    with started(folder) as (address, _):
        yield address


run_on_cluster = partial(run_jobs, workers=1)


@contextmanager
def started(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler and a worker; the address, and the scheduler's process."""
    file = folder / "scheduler.json"
    python = [sys.executable, "-m"]
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}  # workers import the fakes
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": path}
    address = ["--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0", "--scheduler-file"]
    dask_scheduler = subprocess.Popen(  # type: ignore[call-overload]
        [*python, "distributed.cli.dask_scheduler", *address, str(file)], cwd=folder, **quiet
    )
    dask_worker = subprocess.Popen(  # type: ignore[call-overload]
        [*python, "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard"],
        cwd=folder,
        **quiet,
    )
    try:
        end = time.monotonic() + 60
        while not file.exists():
            assert time.monotonic() < end
            time.sleep(0.1)
        yield str(file), dask_scheduler
    finally:
        for process in (dask_worker, dask_scheduler):
            process.send_signal(signal.SIGTERM)
        for process in (dask_worker, dask_scheduler):
            process.wait(30)


@pytest.mark.slow
def test_deaths_and_failures() -> None:
    """A job that takes its worker with it is named; those that waited for it are done."""
    jobs = [job(DARK), job(KILLED), job(MISTAKEN), job(DARK, seed=1)]
    output = dict(run_on_cluster(jobs, cluster="local:1"))
    assert sorted(output) == [0, 1, 2, 3]
    for index in (0, 3):
        check_as_alone(jobs[index], output[index])
    assert output[1] == DIED
    assert str(output[2]).startswith("KeyError at fakes.py:")


@pytest.mark.slow
def test_an_existing_cluster(scheduler: str) -> None:
    jobs = [job(DARK, seed=seed) for seed in (0, 1, 2, 3, 4, 4)]  # equal ones, too, are all done
    begun: list[int] = []
    output = dict(run_on_cluster(jobs, cluster=scheduler, started=begun.append))
    assert sorted(output) == begun == [0, 1, 2, 3, 4, 5]
    assert all(isinstance(outcome, JobResult) for outcome in output.values())


@pytest.mark.slow
def test_left_early(scheduler: str) -> None:
    with closing(run_on_cluster([job(DARK, seed=seed) for seed in range(9)], cluster=scheduler)) as outcomes:
        next(outcomes)
    assert len(dict(run_on_cluster([job(DARK)], cluster=scheduler))) == 1  # it is still there


@pytest.mark.xslow  # Dask tries to connect again for half a minute
def test_a_lost_scheduler(tmp_path: Path) -> None:
    with started(tmp_path) as (address, process):
        outcomes = run_on_cluster([job(DARK, seed=seed) for seed in range(2000)], cluster=address)
        next(outcomes)
        process.kill()
        with pytest.raises(ChildProcessError, match="the scheduler is lost"):
            list(outcomes)


@pytest.mark.slow
def test_a_scheduler_that_dies_while_it_is_connected_to(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def never_connects(self: object, **options: object) -> None:
        await asyncio.sleep(60)

    monkeypatch.setattr("nablahog.jobs.cluster._Client._start", never_connects)
    monkeypatch.setattr("nablahog.jobs.cluster.CONNECT", 0.2)
    with pytest.raises(ChildProcessError, match="there is no Dask scheduler at"):
        list(run_on_cluster([job(DARK)], cluster=scheduler))


@pytest.mark.parametrize(
    ("cluster", "error", "message"),
    [
        ("local:0", ValueError, "expected local:N with at least one process, got 'local:0'"),
        ("nothing.json", ChildProcessError, "expected local, local:N, an address such as tcp://HOST:8786"),
        ("tcp://127.0.0.1:1", ChildProcessError, "there is no Dask scheduler at tcp://127.0.0.1:1"),
    ],
)
def test_no_cluster(cluster: str, error: type[Exception], message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.jobs.cluster.PATIENCE", 1.0)
    monkeypatch.setattr("nablahog.jobs.cluster.CONNECT", 1.0)
    with pytest.raises(error, match=message):
        list(run_on_cluster([job(DARK)], cluster=cluster))


@pytest.mark.parametrize(("ready", "message"), [(False, "has no workers$"), (True, "has no workers any more$")])
def test_a_cluster_without_workers(monkeypatch: pytest.MonkeyPatch, ready: bool, message: str) -> None:
    """From the beginning, or since its last one has gone."""
    if ready:
        monkeypatch.setattr("nablahog.jobs.cluster._Client.wait_for_workers", lambda *_, **options: None)
    monkeypatch.setattr("nablahog.jobs.cluster.PATIENCE", 0.1)
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0", silence_logs=50) as cluster,
        pytest.raises(ChildProcessError, match=f"the cluster {cluster.scheduler_address} {message}"),
    ):
        list(run_on_cluster([job(DARK)], cluster=cluster.scheduler_address))


def test_no_jobs() -> None:
    assert list(run_on_cluster([], cluster="tcp://nowhere:1")) == []


@pytest.mark.slow
def test_carried_files(tmp_path: Path) -> None:
    asked = tmp_path / "there" / "chair.off"
    assert local_path(asked) == asked
    store_files({str(asked): b"OFF"}, tmp_path / "here")
    assert local_path(asked).read_bytes() == b"OFF"
    assert local_path(asked).suffix == ".off"
