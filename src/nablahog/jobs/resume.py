"""Many jobs, each done once: what an earlier run has stored is taken as it is."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from ..io.files import remove_parts
from . import store
from .runner import run_jobs
from .store import Job, JobResult

Name = TypeVar("Name", bound=Hashable)


def do_all(
    folder: Path,
    jobs: Mapping[Name, Job],
    *,
    workers: int,
    progress: Callable[[int, int, str], None] = lambda done, total, at_work: None,
) -> Iterator[tuple[Name, JobResult | str]]:
    """Does what is not done yet, and then gives the results of all.

    Each finished job is stored in ``folder/work`` at once, under a hash of all it depends on, so a run that was
    interrupted, or damaged since, goes on, and one with other settings begins anew beside it.

    Args:
        folder: for the results, which exists.
        jobs: by any names.
        workers: processes to work in.
        progress: called with what is done, the total, and the methods at work.

    Yields:
        In the order of ``jobs``, each name with its result or one sentence why there is none.

    Raises:
        ChildProcessError: worker processes do not start.
        OSError: a result cannot be stored.
    """
    work = folder / "work"
    for written in (folder, *(work / method for method in dict.fromkeys(job.name for job in jobs.values()))):
        remove_parts(written, older_than=60)
    paths = {name: work / job.name / f"{job.key()}.npz" for name, job in jobs.items()}
    reasons = _do({paths[name]: job for name, job in jobs.items()}, workers, progress)
    for name, job in jobs.items():
        result = store.load(paths[name], job)
        yield name, reasons.get(paths[name], "its stored result has vanished") if result is None else result


def _do(jobs: Mapping[Path, Job], workers: int, progress: Callable[[int, int, str], None]) -> dict[Path, str]:
    """Does the jobs that have no whole result at their path; returns why some have none afterwards."""
    missing = [path for path, job in jobs.items() if store.load(path, job) is None]
    at_work: dict[int, str] = {}
    done = len(jobs) - len(missing)

    def tell() -> None:
        progress(done, len(jobs), ", ".join(dict.fromkeys(at_work.values())))

    def started(index: int) -> None:
        at_work[index] = jobs[missing[index]].name
        tell()

    reasons = {}
    tell()
    with closing(run_jobs([jobs[path] for path in missing], workers=workers, started=started)) as outcomes:
        for index, outcome in outcomes:
            if isinstance(outcome, JobResult):
                store.save(missing[index], outcome)
            else:
                reasons[missing[index]] = outcome
            del at_work[index]
            done += 1
            tell()
    return reasons
