"""No worker processes, unless a test is about them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import pytest

from nablahog.jobs import runner
from nablahog.jobs.store import Job, JobResult

from .common import here


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Runs jobs in this process, and lists the methods of those that were begun."""
    done: list[str] = []

    def counted(
        jobs: Sequence[Job], *, workers: int, started: Callable[[int], None]
    ) -> Iterator[tuple[int, JobResult | str]]:
        done.extend(job.name for job in jobs)
        yield from here(jobs, workers=workers, started=started)

    monkeypatch.setattr(runner, "run_jobs", counted)
    return done
