"""Many jobs on all cores, or on a cluster; a job whose process dies is tried again alone."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from typing import Any, Generic

from ..runtime.extras import extra
from .executor import run_on
from .worker import DIED, R, Work, attempt, begin, one_thread


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

    def map_in_order(function: Callable[..., R], *arguments: Iterable[Any]) -> Iterator[R]:
        calls = [Call(function, values) for values in zip(*arguments, strict=True)]
        early: dict[int, R] = {}
        next_index = 0
        with closing(run_anywhere(calls, 1, cluster)) as outcomes:
            for index, outcome in outcomes:
                if isinstance(outcome, str):
                    raise ValueError(outcome)
                early[index] = outcome
                while next_index in early:
                    yield early.pop(next_index)
                    next_index += 1

    return map_in_order


def run_jobs(
    jobs: Sequence[Work[R]], *, workers: int, started: Callable[[int], None] = lambda index: None
) -> Generator[tuple[int, R | str], None, None]:
    """Does all jobs, ``workers`` at a time, each in a process that computes in one thread; see :func:`.run_on`.

    The processes end with this generator; close it (``contextlib.closing``) to stop early.

    Raises:
        ChildProcessError: worker processes do not start.
    """
    with closing(_Processes(workers)) as processes:
        yield from run_on(processes, jobs, started)


class _Processes:
    """Processes of this machine, which hold nothing that must be saved: they are killed, and replaced when one dies."""

    def __init__(self, workers: int) -> None:
        self.most: float = workers
        self.at_work: dict[Future[Any], int] = {}
        self._pool: ProcessPoolExecutor | None = None
        self._size = 0

    def has_room(self) -> bool:
        return len(self.at_work) < self.most

    def submit(self, index: int, job: Work[Any], left: int) -> None:
        while True:
            pool = self._started_pool(left)
            try:
                self.at_work[pool.submit(attempt, job)] = index
            except BrokenProcessPool:
                self.close()
            else:
                return

    def next_outcome(self) -> tuple[int, Any]:
        future = next(iter(wait(self.at_work, return_when=FIRST_COMPLETED).done))
        died = isinstance(future.exception(), BrokenProcessPool)
        return self.at_work.pop(future), DIED if died else future.result()

    def _started_pool(self, left: int) -> ProcessPoolExecutor:
        """The processes, at least one of which has started: new ones if there are none, or too many."""
        if self._pool is not None and self._size <= self.most:
            return self._pool
        self.close()
        self._size = int(min(self.most, left))
        pool = self._pool = ProcessPoolExecutor(self._size, get_context("spawn"), begin)  # a forked PyTorch may hang
        with one_thread(), _no_interrupts():
            ready = [pool.submit(abs, 0) for _ in range(self._size)]
        wait(ready, return_when=FIRST_COMPLETED)
        if any(future.done() and future.exception() for future in ready):
            raise ChildProcessError("worker processes end before they have started")
        return pool

    def close(self) -> None:
        """Kills the processes."""
        if self._pool is not None:
            for process in list((self._pool._processes or {}).values()):
                process.kill()
            self._pool.shutdown()
            self._pool = None


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
