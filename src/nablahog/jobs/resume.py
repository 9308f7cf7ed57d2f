"""Many jobs, each done once: results that an earlier run stored are read."""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from ..io.files import remove_parts
from . import store
from .runner import run_jobs
from .store import Job, JobResult, Work

Name = TypeVar("Name", bound=Hashable)
R = TypeVar("R")


def do_all(
    folder: Path,
    jobs: Mapping[Name, Job],
    *,
    workers: int,
    cluster: str | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, at_work: None,
) -> Iterator[tuple[Name, JobResult | str]]:
    """Does the jobs that have no stored result, then yields the results of all.

    Each result is stored in ``folder/work`` at once, under a hash of everything it depends on.  An interrupted run is
    resumed; a run with other settings starts anew in the same folder.

    Args:
        folder: for the results, which exists.
        jobs: by names of any type.
        workers: processes to work in.
        cluster: a Dask cluster to work on instead, as :func:`.cluster.run_on_cluster` names it.
        progress: called with the number of jobs done, their total, and the names of the methods at work.

    Yields:
        In the order of ``jobs``, each name with its result or one sentence why there is none.

    Raises:
        ValueError: ``cluster`` is no name of a cluster.
        ChildProcessError: worker processes do not start, or the cluster cannot be reached.
        OSError: a result cannot be stored.
    """
    work = folder / "work"
    for written in (folder, *(work / method for method in dict.fromkeys(job.name for job in jobs.values()))):
        remove_parts(written)
    paths = {name: work / job.name / f"{job.key()}.npz" for name, job in jobs.items()}
    reasons = _do({paths[name]: job for name, job in jobs.items()}, workers, cluster, progress)
    for name, job in jobs.items():
        result = store.load(paths[name], job)
        yield name, reasons.get(paths[name], "its stored result has vanished") if result is None else result


def _do(
    jobs: Mapping[Path, Job], workers: int, cluster: str | None, progress: Callable[[int, int, str], None]
) -> dict[Path, str]:
    """Does the jobs without a valid result at their path; returns why jobs failed."""
    missing = [path for path, job in jobs.items() if store.load(path, job) is None]
    at_work: dict[int, str] = {}
    done = len(jobs) - len(missing)

    def report() -> None:
        progress(done, len(jobs), ", ".join(dict.fromkeys(at_work.values())))

    def started(index: int) -> None:
        at_work[index] = jobs[missing[index]].name
        report()

    reasons = {}
    report()
    with closing(run_anywhere([jobs[path] for path in missing], workers, cluster, started)) as outcomes:
        for index, outcome in outcomes:
            if isinstance(outcome, JobResult):
                store.save(missing[index], outcome)
            else:
                reasons[missing[index]] = outcome
            del at_work[index]
            done += 1
            report()
    return reasons


def run_anywhere(
    jobs: Sequence[Work[R]], workers: int, cluster: str | None, started: Callable[[int], None] = lambda index: None
) -> Generator[tuple[int, R | str], None, None]:
    """As :func:`.runner.run_jobs`, or, if ``cluster`` names one, :func:`.cluster.run_on_cluster`.

    Raises:
        ValueError: Dask is not installed.
    """
    if cluster is None:
        return run_jobs(jobs, workers=workers, started=started)
    try:
        from .cluster import run_on_cluster  # loads Dask
    except ModuleNotFoundError as error:
        raise ValueError(f"a cluster needs {error.name}: pip install 'nablahog[cluster]'") from None
    return run_on_cluster(jobs, cluster=cluster, started=started)
