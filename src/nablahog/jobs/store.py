"""Jobs that are done once: each result is a file, named by a hash of everything that it depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from ..io.files import remove_parts, replacing
from .runner import run_jobs
from .worker import Work

Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class JobResult:
    """The outcome of a job: for each row of its method figures, ready for JSON (no NaN), and a picture, (rows, …).

    Pictures of tables are uint8.  Seconds are the wall time of the method.
    """

    figures: Sequence[Mapping[str, Any]]
    pictures: NDArray[Any]
    seconds: float


class Job(Work[JobResult], Protocol):
    """Work of one method, whose result is stored."""

    @property
    def folder(self) -> str:
        """The name of the folder of its stored result: that of the method."""

    def key(self) -> str:
        """A hash of everything the result depends on, including its code (:func:`nablahog.runtime.cache.code_key`)."""

    def fits(self, result: JobResult) -> bool:
        """Whether a stored result has the rows and shapes of this job; damaged files do not."""


def make_key(facts: Mapping[str, object], image: NDArray[np.float32]) -> str:
    """A hash of an image and of facts, ready for JSON, that a result depends on; the version of PyTorch is one."""
    text = json.dumps({**facts, "torch": torch.__version__, "shape": image.shape})
    return hashlib.sha256(text.encode() + image.tobytes()).hexdigest()


def digest(path: Path) -> str:
    """A hash of the contents of a file; computed again when the file changes."""
    state = path.stat()
    return _digest_file(path, state.st_mtime_ns, state.st_size)


@cache
def _digest_file(path: Path, changed: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def save(path: Path, result: JobResult) -> None:
    """Writes ``path`` whole or not at all; makes its folder if missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"figures": list(result.figures), "seconds": result.seconds}, allow_nan=False)
    with replacing(path) as file:
        np.savez(file, figures=np.array(text), pictures=result.pictures)


def load(path: Path, job: Job) -> JobResult | None:
    """Reads what :func:`save` wrote for this job; None if it is missing or damaged in any way."""
    try:
        # opened here, because numpy leaves damaged files open; it compares the checksum of each part
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            stored, pictures = json.loads(str(archive["figures"])), archive["pictures"]
        result = JobResult(stored["figures"], pictures, float(stored["seconds"]))
        return result if job.fits(result) else None
    except Exception:  # damaged archives raise nearly anything
        return None


def do_all(
    folder: Path,
    jobs: Mapping[Name, Job],
    *,
    workers: int,
    label: Callable[[Name], str],
    cluster: str | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, at_work: None,
) -> Iterator[tuple[Name, JobResult | str]]:
    """Does the jobs that have no stored result, then yields the results of all, or one sentence why there is none.

    Each result is stored in ``folder/work`` at once, under a hash of everything it depends on.  An interrupted run is
    resumed; a run with other settings starts anew in the same folder.  ``progress`` is called with the number of jobs
    done, their total, and the ``label`` of the job that is at work the longest.  Further arguments and errors are those
    of :func:`.runner.run_jobs`.

    Raises:
        OSError: a result cannot be stored.
    """
    results = folder / "work"
    for written_to in (folder, *(results / method for method in dict.fromkeys(job.folder for job in jobs.values()))):
        remove_parts(written_to)
    paths = {name: results / job.folder / f"{job.key()}.npz" for name, job in jobs.items()}
    labels = {path: label(name) for name, path in paths.items()}
    reasons = _do_missing({paths[name]: job for name, job in jobs.items()}, labels, workers, cluster, progress)
    for name, job in jobs.items():
        result = load(paths[name], job)
        yield name, reasons.get(paths[name], "its stored result has vanished") if result is None else result


def _do_missing(
    jobs: Mapping[Path, Job],
    labels: Mapping[Path, str],
    workers: int,
    cluster: str | None,
    progress: Callable[[int, int, str], None],
) -> dict[Path, str]:
    """Does the jobs without a valid result at their path; returns why jobs failed."""
    missing = [path for path, job in jobs.items() if load(path, job) is None]
    at_work: dict[int, str] = {}
    done = len(jobs) - len(missing)

    def report() -> None:
        first = next(iter(at_work.values()), "")
        progress(done, len(jobs), f"{first} and {len(at_work) - 1} more" if len(at_work) > 1 else first)

    def started(index: int) -> None:
        at_work[index] = labels[missing[index]]
        report()

    reasons = {}
    report()
    missing_jobs = [jobs[path] for path in missing]
    with closing(run_jobs(missing_jobs, workers=workers, cluster=cluster, started=started)) as outcomes:
        for index, outcome in outcomes:
            if isinstance(outcome, JobResult):
                save(missing[index], outcome)
            else:
                reasons[missing[index]] = outcome
            del at_work[index]
            done += 1
            report()
    return reasons
