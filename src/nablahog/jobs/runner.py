"""Many jobs on all cores, or on a cluster; a job whose process dies is tried again alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Protocol

from ..runtime.extras import extra
from .processes import Processes
from .worker import DIED, R, Work


class Executor(Protocol):
    """Processes that do jobs, ``most`` at once; ``at_work`` are the indices of those that have no outcome yet."""

    most: float
    at_work: dict[Any, int]

    def has_room(self) -> bool:
        """Whether another job can be at work."""

    def submit(self, index: int, job: Work[Any], left: int) -> None:
        """Sends a job to a process; with this one, ``left`` jobs are not yet at work."""

    def next_outcome(self) -> tuple[int, Any]:
        """Waits until a job at work ends: its index, and its result or one sentence why there is none.

        The sentence is :data:`.worker.DIED` where a process died, by this job or by another one.
        """


def run_jobs(
    jobs: Sequence[Work[R]],
    *,
    workers: int,
    cluster: str | None = None,
    started: Callable[[int], None] = lambda index: None,
) -> Generator[tuple[int, R | str], None, None]:
    """Does all jobs, each in a process that computes in one thread: ``workers`` at a time, or on a ``cluster``.

    Jobs are started in their order, and ``started`` is called with the index.  Jobs that were at work when a process
    died are tried again in the end, one by one: perhaps for want of memory that is free then.  The processes of this
    machine end with this generator; close it (``contextlib.closing``) to stop early.

    Yields:
        The index of each finished job, with its result or one sentence why it failed.

    Raises:
        ValueError: as :func:`.cluster.open_cluster`, or Dask is not installed.
        ChildProcessError: as :func:`.cluster.open_cluster`, or processes of this machine do not start.
    """
    if not jobs:
        return
    with open_executor(jobs, workers, cluster) as executor:
        suspects = deque[int]()
        for index, outcome in _run(executor, jobs, deque(range(len(jobs))), started):
            if outcome == DIED:
                suspects.append(index)
            else:
                yield index, outcome
        executor.most = 1
        yield from _run(executor, jobs, suspects, started)


def _run(
    executor: Executor, jobs: Sequence[Work[R]], queue: deque[int], started: Callable[[int], None]
) -> Iterator[tuple[int, R | str]]:
    while queue or executor.at_work:
        while queue and executor.has_room():
            executor.submit(queue[0], jobs[queue[0]], len(queue))
            started(queue.popleft())
        yield executor.next_outcome()


@contextmanager
def open_executor(jobs: Sequence[Work[R]], workers: int, cluster: str | None) -> Iterator[Executor]:
    """The processes for some jobs, which end with the block if they are of this machine."""
    if cluster is None:
        with closing(Processes(workers)) as processes:
            yield processes
        return
    with extra("cluster", "a cluster"):
        from .cluster import open_cluster  # loads Dask
    with open_cluster(cluster, jobs) as tasks:
        yield tasks


@dataclass(frozen=True, eq=False)
class Call(Generic[R]):
    """A function with its arguments, as work."""

    function: Callable[..., R]
    arguments: tuple[Any, ...]

    def run(self) -> R:
        """Calls it."""
        return self.function(*self.arguments)


def map_on(cluster: str) -> Callable[..., Iterator[Any]]:
    """A ``map`` that works on a cluster; it raises ValueError where a call fails, else as :func:`run_jobs`."""

    def map_in_order(function: Callable[..., R], *arguments: Iterable[Any]) -> Iterator[R]:
        calls = [Call(function, values) for values in zip(*arguments, strict=True)]
        early: dict[int, R] = {}
        next_index = 0
        with closing(run_jobs(calls, workers=1, cluster=cluster)) as outcomes:
            for index, outcome in outcomes:
                if isinstance(outcome, str):
                    raise ValueError(outcome)
                early[index] = outcome
                while next_index in early:
                    yield early.pop(next_index)
                    next_index += 1

    return map_in_order
