"""Results on disk: one file for each job, named by a hash of everything the result depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from ..io.files import replacing

R_co = TypeVar("R_co", covariant=True)


@dataclass(frozen=True)
class JobResult:
    """The outcome of a job.

    Attributes:
        figures: one mapping for each row of its method, ready for JSON: no NaN.
        pictures: one for each row, (rows, ...), uint8 in a table.
        seconds: wall time of the method.
    """

    figures: Sequence[Mapping[str, Any]]
    pictures: NDArray[Any]
    seconds: float


class Work(Protocol[R_co]):
    """Work that can be sent to another process; its result is no text.

    If it reads files, it has a method ``files`` that returns their paths, and opens :func:`.job_files.local_path` of
    them.
    """

    def run(self) -> R_co:
        """Does the work; the same result every time.

        Raises:
            ValueError, OSError: why there is no result, in one sentence.
        """


class Job(Work[JobResult], Protocol):
    """Work of one method, whose result is stored."""

    @property
    def name(self) -> str:
        """The name of the method."""

    def key(self) -> str:
        """A hash of everything the result depends on, including its code (:func:`nablahog.runtime.cache.code_key`)."""

    def fits(self, result: JobResult) -> bool:
        """Whether a stored result has the rows and shapes of this job; damaged files do not."""


def key_of(facts: Mapping[str, object], image: NDArray[np.float32]) -> str:
    """A hash of an image and of facts, ready for JSON, that a result depends on; the version of PyTorch is one."""
    text = json.dumps({**facts, "torch": torch.__version__, "shape": image.shape})
    return hashlib.sha256(text.encode() + image.tobytes()).hexdigest()


def digest(path: Path) -> str:
    """A hash of the contents of a file; computed again when the file changes."""
    state = path.stat()
    return _digest_of(path, state.st_mtime_ns, state.st_size)


@cache
def _digest_of(path: Path, changed: int, size: int) -> str:
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
