"""Many jobs on all cores; a worker that dies is replaced."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from typing import TypeVar

from .store import Work
from .worker import serve

R = TypeVar("R")

ATTEMPTS = 2  # at a job whose worker dies, perhaps for want of memory that is free later
STARTS = 3  # workers that may die before they are ready, one after another


def cores() -> int:
    """The number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Worker:
    """A process and the parent's end of the pipe to it.

    Attributes:
        ready: whether it has started.
        job: the index of its job, None while idle.
    """

    def __init__(self) -> None:
        context = get_context("spawn")  # a forked PyTorch may hang
        self.connection, child_end = context.Pipe()
        self.process = context.Process(target=serve, args=(child_end,), daemon=True)
        self.ready = False
        self.job: int | None = None
        with one_thread(), _no_interrupts():
            self.process.start()
        child_end.close()  # so that the death of the process ends the pipe

    def end(self) -> None:
        """Kills the process; it holds nothing that must be saved."""
        self.process.kill()
        self.connection.close()

    def how_it_died(self) -> str:
        """The signal or the exit status of a process that was not ended by us."""
        self.process.join(5)
        code = self.process.exitcode
        if code is not None and code < 0:
            names = {number.value: number.name for number in signal.Signals}
            return f"signal {names.get(-code, -code)}"
        return f"exit status {code}"


@contextmanager
def one_thread() -> Iterator[None]:
    """Child processes started in the block compute in one thread each: the libraries under PyTorch read this first."""
    before = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = before


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Child processes started in the block ignore Ctrl-C; the parent handles it, after the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_jobs(
    jobs: Sequence[Work[R]], *, workers: int, started: Callable[[int], None] = lambda index: None
) -> Generator[tuple[int, R | str], None, None]:
    """Does all jobs, ``workers`` at a time, each in a process that computes in one thread.

    A result depends on nothing but its job.  The processes end with this generator; close it (``contextlib.closing``)
    to stop early.

    Args:
        jobs: started in this order.
        workers: processes, at least 1.
        started: called with the index of a job when it is started.

    Yields:
        The index of each finished job, with its result or one sentence why it failed.

    Raises:
        ChildProcessError: worker processes do not start.
    """
    queue, attempts = deque(range(len(jobs))), [0] * len(jobs)
    pool: dict[Connection, _Worker] = {}
    deaths = 0
    try:
        while queue or any(worker.job is not None for worker in pool.values()):
            while queue and len(pool) < min(workers, len(jobs)):
                worker = _Worker()
                pool[worker.connection] = worker
            for worker in pool.values():
                if queue and worker.ready and worker.job is None:
                    worker.job = queue.popleft()
                    attempts[worker.job] += 1
                    started(worker.job)
                    with suppress(OSError):  # it has died: handled below
                        worker.connection.send(jobs[worker.job])
            for connection in wait(list(pool)):
                assert isinstance(connection, Connection)
                worker = pool[connection]
                try:
                    answer: R | str = connection.recv()
                except (EOFError, OSError):
                    del pool[connection]
                    how = worker.how_it_died()
                    worker.end()
                    deaths += not worker.ready
                    if deaths == STARTS:
                        raise ChildProcessError(f"worker processes end before they have started ({how})") from None
                    if worker.job is None:
                        continue
                    if attempts[worker.job] < ATTEMPTS:
                        queue.append(worker.job)
                        continue
                    answer = f"the process at work on it died, {ATTEMPTS} times, the last time by {how}"
                if worker.ready:
                    index, worker.job = worker.job, None
                    assert index is not None
                    yield index, answer
                worker.ready, deaths = True, 0
    finally:
        for worker in pool.values():
            worker.end()
        for worker in pool.values():
            worker.process.join()
