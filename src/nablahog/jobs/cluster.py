"""Many jobs on a Dask cluster: one that is there, or processes of this machine that Dask manages.

Each job is a task.  A worker that dies is Dask's matter, which gives its tasks to others, until it blames them for
too many deaths.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import dask
import torch
from distributed import Client, LocalCluster, Worker, WorkerPlugin
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker
from distributed.utils import silence_logging_cmgr

from .worker import DIED, R, Work, attempt, cores, one_thread, store_files

logger = logging.getLogger(__name__)

RECOUNT = 5.0  # seconds between counts of the workers, which come and go
AHEAD = 2  # jobs for each thread of the cluster, so that none waits for this process
CONNECT = 20.0  # seconds to wait for a scheduler, at first and when it is lost
PATIENCE = 60.0  # seconds to wait for a worker
PLUGIN = "nablahog-files"
LOST = (CommClosedError, FutureCancelledError, CancelledError)  # what Dask raises when its scheduler has gone


@contextmanager
def open_cluster(cluster: str, jobs: Sequence[Work[R]]) -> Iterator[Tasks]:
    """A cluster that is ready for jobs: its workers have the files that these read.

    It is ``local`` or ``local:N``, N processes of this machine; the address of a scheduler, such as
    ``tcp://HOST:PORT``; or the JSON file that it wrote.

    Raises:
        ValueError: ``cluster`` is none of these.
        ChildProcessError: there is no such cluster, it has no workers, at first or later, or its scheduler is lost.
    """
    with _connected(cluster) as client, _scheduler_errors():
        logger.info("the dashboard of the cluster: %s", client.dashboard_link)
        _prepare(client, jobs)
        yield Tasks(client, cluster)


class Tasks:
    """An :class:`.runner.Executor`.  Dask blames a worker's death also on tasks that were only queued there."""

    def __init__(self, client: Client, cluster: str) -> None:
        self.client, self.cluster = client, cluster
        self.most = math.inf
        self.at_work: dict[Any, int] = {}
        self._ended = SimpleQueue[Any]()
        self._threads, self._counted = 1, -math.inf

    def has_room(self) -> bool:
        if time.monotonic() > self._counted + RECOUNT:
            self._threads, self._counted = max(1, sum(self.client.nthreads().values())), time.monotonic()
        return len(self.at_work) < min(self.most, AHEAD * self._threads)

    def submit(self, index: int, job: Work[Any], left: int) -> None:
        future = self.client.submit(attempt, job, pure=False)
        self.at_work[future.key] = index
        future.add_done_callback(self._ended.put)

    def next_outcome(self) -> tuple[int, Any]:
        while True:
            try:
                future = self._ended.get(timeout=PATIENCE)
            except Empty:
                self._check_workers()
                continue
            if future.status != "lost":
                return self.at_work.pop(future.key), self._outcome(future)
            future.add_done_callback(self._ended.put)  # the result, with its worker; Dask computes it again

    def _outcome(self, future: Any) -> Any:
        """The outcome of a task that has ended; waits for it again if it was lost with its worker since."""
        while True:
            try:
                return future.result(timeout=PATIENCE)
            except asyncio.TimeoutError:  # noqa: PERF203
                self._check_workers()
            except KilledWorker:
                return DIED
            except (*LOST, ChildProcessError):
                raise
            except Exception as error:  # not raised by the job: workers may have another version of the package
                return f"{type(error).__name__}: {' '.join(str(error).split())}"

    def _check_workers(self) -> None:
        if not self.client.nthreads():
            raise ChildProcessError(f"the cluster {self.cluster} has no workers any more")


@contextmanager
def _connected(cluster: str) -> Iterator[Client]:
    """A client of the cluster; one of this machine's own processes ends with the block."""
    match = re.fullmatch(r"local(?::(\d{1,4}))?", cluster)
    failures = {"distributed.scheduler.allowed-failures": 0}  # for own processes: a job that died is tried alone
    with dask.config.set(failures), silence_logging_cmgr(logging.CRITICAL):
        if match is None:
            with _client(cluster) as client:
                try:
                    client.wait_for_workers(1, timeout=PATIENCE)
                except asyncio.TimeoutError:  # Dask's own is one, which before Python 3.11 is no TimeoutError
                    raise ChildProcessError(f"the cluster {cluster} has no workers") from None
                yield client
            return
        workers = int(match[1] or cores())
        if workers < 1:
            raise ValueError(f"expected local:N with at least one process, got {cluster!r}")
        with (
            one_thread(),
            LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
            ) as local,
            Client(local, timeout=CONNECT) as client,
        ):
            yield client


class _Client(Client):
    """A client that does not wait for ever for a scheduler that dies while they connect."""

    def start(self, **options: Any) -> None:
        """As of Dask, which limits the time of each step, but not that of all of them."""
        self._loop_runner.start()
        self.sync(self._start, callback_timeout=2 * CONNECT, **options)  # type: ignore[no-untyped-call]


def _client(cluster: str) -> Client:
    no_scheduler = f"there is no Dask scheduler at {cluster}"
    where = "address" if re.fullmatch(r"[a-z]+://\S+", cluster) else "scheduler_file"
    if where == "scheduler_file" and not Path(cluster).is_file():
        expected = "local, local:N, an address such as tcp://HOST:8786, or a scheduler's file"
        raise ChildProcessError(f"{no_scheduler}: expected {expected}")
    try:
        return _Client(**{where: cluster}, timeout=CONNECT, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, asyncio.TimeoutError, ValueError) as error:
        raise ChildProcessError(f"{no_scheduler}: {error}") from None


@contextmanager
def _scheduler_errors() -> Iterator[None]:
    """Raises ChildProcessError where Dask says in one of many ways that its scheduler has gone."""
    try:
        yield
    except LOST as error:
        raise ChildProcessError(f"the scheduler is lost: {' '.join(str(error).split()) or 'it has closed'}") from None


class _Files(WorkerPlugin):
    """Puts the files that jobs read beside a worker when it starts, and makes it compute in one thread a job."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files = files

    def setup(self, worker: Worker) -> None:
        torch.set_num_threads(1)
        store_files(self.files, Path(worker.local_directory, PLUGIN))


def _prepare(client: Client, jobs: Sequence[Work[R]]) -> None:
    """Sends the files that jobs read to each worker, once."""
    paths = dict.fromkeys(path for job in jobs for path in getattr(job, "files", list)())
    files = {str(path): path.read_bytes() for path in paths}
    client.register_plugin(_Files(files), name=PLUGIN)
