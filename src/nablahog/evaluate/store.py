"""Finished work on disk: one file for each image and method, found again only by exactly the same work."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from ..output import replacing
from .methods import Method, Settings

Figures: TypeAlias = dict[str, float | None]  # by metric; None where one is not defined
PACKAGE = Path(__file__).parents[1]
DECIDING = ("compile.py", "hog", "optimize", "invert", "metrics.py")
"""The parts of the package that decide what is found and how it is measured."""


@dataclass(frozen=True)
class Job:
    """One method on one image, (H, W) float32 in 0…1."""

    method: Method
    image: NDArray[np.float32]
    settings: Settings


@dataclass(frozen=True)
class Result:
    """What became of it, for each row of the method.

    Attributes:
        figures: one mapping for each row.
        pictures: (rows, H, W), 8-bit.
        seconds: wall time of the method.
    """

    figures: Sequence[Figures]
    pictures: NDArray[np.uint8]
    seconds: float


def key(job: Job) -> str:
    """A hash of everything a result depends on: image, method, settings, and the code that makes it."""
    settings, method = job.settings, job.method
    prior = settings.prior if method.uses_prior else None
    facts = {
        "method": method.name,
        "rows": method.rows,
        "spec": None if method.spec is None else method.spec.to_json(),
        "seed": settings.seed,
        "max_evaluations": settings.max_evaluations,
        "prior": None if prior is None else _digest(prior),
        "code": [_code(), _digest(_source(method))],
        "torch": torch.__version__,
        "shape": job.image.shape,
    }
    return hashlib.sha256(json.dumps(facts).encode() + job.image.tobytes()).hexdigest()


def _source(method: Method) -> Path:
    run: Any = method.run
    return Path(inspect.getfile(run.func if isinstance(run, partial) else run))


def _digest(path: Path) -> str:
    state = path.stat()
    return _digest_of(path, state.st_mtime_ns, state.st_size)


@cache
def _digest_of(path: Path, changed: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _code() -> str:
    return hashlib.sha256("".join(f"{path.name} {_digest(path)}\n" for path in _files()).encode()).hexdigest()


def _files() -> Iterator[Path]:
    for part in DECIDING:
        path = PACKAGE / part
        below = sorted(file for file in path.rglob("*") if file.is_file() and "__pycache__" not in file.parts)
        yield from below if path.is_dir() else [path]


def save(path: Path, result: Result) -> None:
    """Writes ``path``, whole or not at all, and the folder it is in, if missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"figures": list(result.figures), "seconds": result.seconds}, allow_nan=False)
    with replacing(path) as file:
        np.savez(file, figures=np.array(text), pictures=result.pictures)


def load(path: Path, job: Job) -> Result | None:
    """What :func:`save` wrote for this job; None if it is missing or damaged in any way."""
    try:
        # opened here, because numpy leaves damaged files open; it compares the checksum of each part
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            stored, pictures = json.loads(str(archive["figures"])), archive["pictures"]
        result = Result(stored["figures"], pictures, float(stored["seconds"]))
    except Exception:  # damaged archives raise nearly anything
        return None
    rows = len(job.method.rows)
    whole = len(result.figures) == rows and pictures.shape == (rows, *job.image.shape) and pictures.dtype == np.uint8
    return result if whole else None
