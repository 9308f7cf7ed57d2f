"""Finished work on disk: one file for each job, found again only by exactly the same work."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..io.files import replacing

PACKAGE = Path(__file__).parents[1]


@dataclass(frozen=True)
class JobResult:
    """What became of a job.

    Attributes:
        figures: one mapping for each row of its method, ready for JSON, which knows no NaN.
        pictures: one for each row, 8-bit, their number first.
        seconds: wall time of the method.
    """

    figures: Sequence[Mapping[str, Any]]
    pictures: NDArray[np.uint8]
    seconds: float


class Work(Protocol):
    """What is sent to another process to be done there."""

    def run(self) -> JobResult:
        """Does it, the same every time.

        Raises:
            ValueError, OSError: there is no result, and why, in one sentence.
        """


class Job(Work, Protocol):
    """Work of one method, whose result is stored."""

    @property
    def name(self) -> str:
        """That of the method."""

    def key(self) -> str:
        """A hash of everything the result depends on, the code that makes it included: see :func:`code`."""

    def fits(self, result: JobResult) -> bool:
        """Whether a stored result can be of this job: one of another version, or damaged, is not."""


def source(function: Callable[..., Any]) -> Path:
    """The file that a function, or the function of a ``functools.partial``, is written in."""
    return Path(inspect.getfile(function.func if isinstance(function, partial) else function))


def digest(path: Path) -> str:
    """A hash of what a file holds, computed again when it changes."""
    state = path.stat()
    return _digest_of(path, state.st_mtime_ns, state.st_size)


@cache
def _digest_of(path: Path, changed: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def code(*parts: str) -> str:
    """A hash of files of this package, and of all files in folders of it, by their names."""
    return hashlib.sha256("".join(f"{path.name} {digest(path)}\n" for path in files(*parts)).encode()).hexdigest()


def files(*parts: str) -> Iterator[Path]:
    """What :func:`code` is made of."""
    for part in parts:
        path = PACKAGE / part
        below = sorted(file for file in path.rglob("*") if file.is_file() and "__pycache__" not in file.parts)
        yield from below if path.is_dir() else [path]


def save(path: Path, result: JobResult) -> None:
    """Writes ``path``, whole or not at all, and the folder it is in, if missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"figures": list(result.figures), "seconds": result.seconds}, allow_nan=False)
    with replacing(path) as file:
        np.savez(file, figures=np.array(text), pictures=result.pictures)


def load(path: Path, job: Job) -> JobResult | None:
    """What :func:`save` wrote for this job; None if it is missing or damaged in any way."""
    try:
        # opened here, because numpy leaves damaged files open; it compares the checksum of each part
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            stored, pictures = json.loads(str(archive["figures"])), archive["pictures"]
        result = JobResult(stored["figures"], pictures, float(stored["seconds"]))
        return result if job.fits(result) else None
    except Exception:  # damaged archives raise nearly anything
        return None
