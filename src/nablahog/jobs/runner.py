"""Many jobs on all cores; a job whose process dies is tried again alone."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing import get_context, resource_tracker
from typing import TypeVar

from .store import Work
from .worker import attempt, begin

R = TypeVar("R")

DIED = "the process at work on it died, and died again when it ran alone"


def cores() -> int:
    """The number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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

    A result depends on nothing but its job.  When a process dies, all jobs at work are tried again in the end, one by
    one: perhaps for want of memory that is free then.  The processes end with this generator; close it
    (``contextlib.closing``) to stop early.

    Args:
        jobs: started in this order.
        workers: processes, at least 1.
        started: called with the index of a job when it is started.

    Yields:
        The index of each finished job, with its result or one sentence why it failed.

    Raises:
        ChildProcessError: worker processes do not start.
    """
    queue, suspects = deque(range(len(jobs))), deque[int]()
    while queue:
        with closing(_until_a_death(jobs, queue, workers, started)) as futures:
            for index, future in futures:
                if isinstance(future.exception(), BrokenProcessPool):
                    suspects.append(index)
                else:
                    yield index, future.result()
    while suspects:
        with closing(_until_a_death(jobs, suspects, 1, started)) as futures:
            for index, future in futures:
                yield index, DIED if isinstance(future.exception(), BrokenProcessPool) else future.result()


def _until_a_death(
    jobs: Sequence[Work[R]], queue: deque[int], workers: int, started: Callable[[int], None]
) -> Generator[tuple[int, Future[R | str]], None, None]:
    """Does jobs of the queue until it is empty, or a process dies; yields all that it has started."""
    size = min(workers, len(queue))
    with _pool(size) as pool:
        at_work: dict[Future[R | str], int] = {}
        broken = False
        while at_work or (queue and not broken):
            while queue and len(at_work) < size and not broken:
                try:
                    future = pool.submit(attempt, jobs[queue[0]])
                except BrokenProcessPool:  # noqa: PERF203
                    broken = True
                else:
                    at_work[future] = queue.popleft()
                    started(at_work[future])
            for future in wait(at_work, return_when=FIRST_COMPLETED).done:
                broken |= isinstance(future.exception(), BrokenProcessPool)
                yield at_work.pop(future), future


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes, at least one of which has started.  They hold nothing that must be saved, and are killed in the end.

    Raises:
        ChildProcessError: they do not start.
    """
    pool = ProcessPoolExecutor(workers, get_context("spawn"), begin)  # a forked PyTorch may hang
    try:
        with one_thread(), _no_interrupts():
            ready = [pool.submit(abs, 0) for _ in range(workers)]
        wait(ready, return_when=FIRST_COMPLETED)
        if any(future.done() and future.exception() for future in ready):
            raise ChildProcessError("worker processes end before they have started")
        yield pool
    finally:
        for process in list((pool._processes or {}).values()):
            process.kill()
        pool.shutdown()
