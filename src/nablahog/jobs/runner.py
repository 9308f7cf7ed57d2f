"""Many jobs on all cores, or on a cluster; a job whose process dies is tried again alone."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from typing import Any, Generic, TypeVar

from ..runtime.extras import extra
from .worker import DIED, Work, attempt, begin, one_thread

R = TypeVar("R")


def run_anywhere(
    jobs: Sequence[Work[R]], workers: int, cluster: str | None, started: Callable[[int], None] = lambda index: None
) -> Generator[tuple[int, R | str], None, None]:
    """As :func:`run_jobs`, or, if ``cluster`` names one, :func:`.cluster.run_on_cluster`; ValueError without Dask."""
    if cluster is None:
        return run_jobs(jobs, workers=workers, started=started)
    with extra("cluster", "a cluster"):
        from .cluster import run_on_cluster  # loads Dask
    return run_on_cluster(jobs, cluster=cluster, started=started)


@dataclass(frozen=True, eq=False)
class Call(Generic[R]):
    """A function with its arguments, as work."""

    function: Callable[..., R]
    arguments: tuple[Any, ...]

    def run(self) -> R:
        """Calls it."""
        return self.function(*self.arguments)


def map_on(cluster: str) -> Callable[..., Iterator[Any]]:
    """A ``map`` that works on a cluster; it raises ValueError where a call fails, else as :func:`run_anywhere`."""

    def mapped(function: Callable[..., R], *arguments: Iterable[Any]) -> Iterator[R]:
        calls = [Call(function, each) for each in zip(*arguments, strict=True)]
        early: dict[int, R] = {}
        wanted = 0
        with closing(run_anywhere(calls, 1, cluster)) as outcomes:
            for index, outcome in outcomes:
                if isinstance(outcome, str):
                    raise ValueError(outcome)
                early[index] = outcome
                while wanted in early:
                    yield early.pop(wanted)
                    wanted += 1

    return mapped


def run_jobs(
    jobs: Sequence[Work[R]], *, workers: int, started: Callable[[int], None] = lambda index: None
) -> Generator[tuple[int, R | str], None, None]:
    """Does all jobs, ``workers`` at a time, each in a process that computes in one thread.

    Jobs are started in their order, and ``started`` is called with the index.  When a process dies, all jobs at work
    are tried again in the end, one by one: perhaps for want of memory that is free then.  The processes end with this
    generator; close it (``contextlib.closing``) to stop early.

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


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes, at least one of which has started.  They hold nothing that must be saved, and are killed."""
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
