"""The order of many jobs, whatever does them: a job whose process dies is tried again alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from .worker import DIED, R, Work


class Executor(Protocol):
    """Processes that do jobs.

    Attributes:
        most: jobs at work at once, at most.
        at_work: the indices of the jobs that were submitted and have no outcome yet, by future or its name.
    """

    most: float
    at_work: dict[Any, int]

    def has_room(self) -> bool:
        """Whether another job can be at work."""

    def submit(self, index: int, job: Work[Any], left: int) -> None:
        """Sends a job to a process.

        Args:
            index: of the job.
            job: whose process may die.
            left: jobs that are not yet at work, with this one.

        Raises:
            ChildProcessError: there are no processes.
        """

    def next_outcome(self) -> tuple[int, Any]:
        """Waits until a job at work has ended: its index, and its result or one sentence why there is none.

        The sentence is :data:`.worker.DIED` where the process may have died by this job, or by another one.

        Raises:
            ChildProcessError: there are no processes any more.
        """


def run_on(
    executor: Executor, jobs: Sequence[Work[R]], started: Callable[[int], None]
) -> Iterator[tuple[int, R | str]]:
    """Does all jobs.

    Jobs are started in their order, and ``started`` is called with the index.  Jobs that were at work when a process
    died are tried again in the end, one by one: perhaps for want of memory that is free then.

    Yields:
        The index of each finished job, with its result or one sentence why it failed.
    """
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
