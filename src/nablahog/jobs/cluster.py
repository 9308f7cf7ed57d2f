"""Many jobs on a Dask cluster: one that is there, or processes of this machine that Dask manages.

Jobs go in chunks that take about :data:`CHUNK_SECONDS`, by the time that the first ones took, or longer on many
workers: the scheduler's own work for a chunk is then below 5 % of it.  A worker that dies is Dask's matter, which gives
its tasks to others; the jobs of a task that takes its workers with it are done again in the end, one by one, so that it
is known which one is to blame.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import dask
import torch
from distributed import Client, LocalCluster, Worker, WorkerPlugin
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker
from distributed.utils import silence_logging_cmgr

from .job_files import store_files
from .runner import cores, one_thread
from .store import Work
from .worker import attempt

R = TypeVar("R")

logger = logging.getLogger(__name__)

CHUNK_SECONDS = 0.5  # or more, on so many threads that the scheduler would have more than
CHUNKS_A_SECOND = 100.0
RECOUNT = 5.0  # seconds
MOST_IN_CHUNK = 1000
AHEAD = 2  # chunks for each thread of the cluster, so that none waits for this process
DEATHS = 2  # of processes of this machine, with the same task, until it fails: as without Dask
CONNECT = 20.0  # seconds to wait for a scheduler, at first and when it is lost
PATIENCE = 60.0  # seconds to wait for a worker
PLUGIN = "nablahog-files"
LOST = (CommClosedError, FutureCancelledError, CancelledError)  # what Dask raises when its scheduler has gone


def run_on_cluster(
    jobs: Sequence[Work[R]],
    *,
    cluster: str,
    started: Callable[[int], None] = lambda index: None,
) -> Generator[tuple[int, R | str], None, None]:
    """Does all jobs on a cluster, each in one thread.

    A result depends on nothing but its job.  Close the generator (``contextlib.closing``) to stop early.

    Args:
        jobs: sent in this order.
        cluster: ``local`` or ``local:N``, N processes of this machine; the address of a scheduler, such as
            ``tcp://HOST:PORT``; or the JSON file that it wrote.
        started: called with the index of a job when it is sent.

    Yields:
        The index of each finished job, with its result or one sentence why it failed.

    Raises:
        ValueError: ``cluster`` is none of these.
        ChildProcessError: there is no such cluster, it has no workers, at first or later, or its scheduler is lost.
    """
    if not jobs:
        return
    with _connected(cluster) as client, _scheduler_errors():
        logger.info("the dashboard of the cluster: %s", client.dashboard_link)
        _prepare(client, jobs)
        waiting = _Waiting(len(jobs))
        chunks: dict[Any, list[int]] = {}
        ended = SimpleQueue[Any]()
        threads = _Threads(client)

        def send() -> None:
            count = threads.count()
            room = AHEAD * count - len(chunks)
            while room > 0 and (chunk := waiting.next(count, alone=not chunks)):
                for index in chunk:
                    started(index)
                future = client.submit(attempt_all, [jobs[index] for index in chunk], pure=False)
                chunks[future.key] = chunk
                future.add_done_callback(ended.put)
                room -= 1

        send()
        while chunks:
            try:
                future = ended.get(timeout=PATIENCE)
            except Empty:
                if not client.nthreads():
                    raise ChildProcessError(f"the cluster {cluster} has no workers any more") from None
                continue
            if future.status == "lost":  # with its worker, before it was read; Dask has it computed again
                future.add_done_callback(ended.put)
                continue
            chunk = chunks.pop(future.key)
            try:
                seconds, answers = _result(future, client, cluster)
            except KilledWorker as error:
                if waiting.suspect(chunk):
                    yield chunk[0], f"the process at work on it died, {error.allowed_failures + 1} times"
            except (*LOST, ChildProcessError):
                raise
            except Exception as error:  # no job's: perhaps workers have another version, and cannot read it
                for index in chunk:
                    yield index, f"{type(error).__name__}: {' '.join(str(error).split())}"
            else:
                waiting.took(seconds, len(chunk))
                yield from zip(chunk, answers, strict=True)
            send()


def _result(future: Any, client: Client, cluster: str) -> Any:
    """The result of a future that has ended; waits for it again if it was lost with its worker since."""
    while True:
        try:
            return future.result(timeout=PATIENCE)
        except asyncio.TimeoutError:  # noqa: PERF203
            if not client.nthreads():
                raise ChildProcessError(f"the cluster {cluster} has no workers any more") from None


def attempt_all(jobs: Sequence[Work[R]]) -> tuple[float, list[R | str]]:
    """The seconds that jobs took on a worker, and their results, or why there are none."""
    began = time.perf_counter()
    answers = [attempt(job) for job in jobs]
    return time.perf_counter() - began, answers


class _Threads:
    """Those of all workers, which come and go; asked for every :data:`RECOUNT` seconds."""

    def __init__(self, client: Client) -> None:
        self._client, self._count, self._asked = client, 1, -math.inf

    def count(self) -> int:
        """At least 1."""
        if time.monotonic() - self._asked > RECOUNT:
            self._count = max(1, sum(self._client.nthreads().values()))
            self._asked = time.monotonic()
        return self._count


class _Waiting:
    """Jobs that were not sent yet, in chunks of about :data:`CHUNK_SECONDS`.

    Dask blames all tasks that a dead worker had, those too that only waited for it.  So jobs of such tasks are sent
    again in the end, one by one, with nothing else under way.

    Args:
        count: of the jobs.
    """

    def __init__(self, count: int) -> None:
        self._indices, self._suspects = deque(range(count)), deque[int]()
        self._seconds = self._done = 0.0
        self._tried: set[int] = set()

    def next(self, threads: int, alone: bool) -> list[int]:
        """The next chunk; empty if there is none, or none unless ``alone``, when nothing is under way.

        The last chunks are smaller, so that all ``threads`` of the cluster end at nearly the same time.
        """
        each = self._seconds / self._done if self._done else CHUNK_SECONDS
        wanted = max(CHUNK_SECONDS, threads / CHUNKS_A_SECOND)
        share = math.ceil(len(self._indices) / (AHEAD * threads))
        size = max(1, min(MOST_IN_CHUNK, round(wanted / max(each, 1e-6)), share))
        chunk = [self._indices.popleft() for _ in range(min(size, len(self._indices)))]
        if not chunk and self._suspects and alone:
            chunk = [self._suspects.popleft()]
            self._tried.add(chunk[0])
        return chunk

    def took(self, seconds: float, count: int) -> None:
        """Jobs are done."""
        self._seconds, self._done = self._seconds + seconds, self._done + count

    def suspect(self, chunk: Sequence[int]) -> bool:
        """Whether a chunk that took its workers with it was a job alone; else its jobs are sent again in the end."""
        if len(chunk) == 1 and chunk[0] in self._tried:
            return True
        self._suspects.extend(chunk)
        return False


@contextmanager
def _connected(cluster: str) -> Iterator[Client]:
    """A client of the cluster; one of this machine's own processes ends with the block."""
    match = re.fullmatch(r"local(?::(\d{1,4}))?", cluster)
    failures = {"distributed.scheduler.allowed-failures": DEATHS - 1}
    with dask.config.set(failures), silence_logging_cmgr(logging.CRITICAL):
        if match is None:
            try:
                client = _client(cluster)
            except (OSError, TimeoutError, asyncio.TimeoutError, ValueError) as error:
                raise ChildProcessError(f"there is no Dask scheduler at {cluster}: {error}") from None
            with client:
                try:
                    client.wait_for_workers(1, timeout=PATIENCE)
                except TimeoutError:
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
    where = {"address": cluster}
    if not re.fullmatch(r"[a-z]+://\S+", cluster):
        if not Path(cluster).is_file():
            raise ValueError("expected local, local:N, an address such as tcp://HOST:8786, or a scheduler's file")
        where = {"scheduler_file": cluster}
    return _Client(**where, timeout=CONNECT, set_as_default=False)  # type: ignore[no-untyped-call]


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
