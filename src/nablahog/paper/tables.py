"""Parts of both tables: statistics, results of all methods, failures, and files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..io.files import write_text
from ..jobs.store import Job, do_all
from ..runtime.text import guard_formula, printable
from ..viz.html import Cell, Section, figure

RESAMPLES = 10_000


@dataclass(frozen=True)
class Statistics:
    """Mean and median of n values, and a 95 % interval of one of the two; None if there are no values."""

    mean: float | None
    median: float | None
    low: float | None
    high: float | None
    n: int


def statistics(
    values: Sequence[float] | NDArray[np.float64], average: Callable[..., NDArray[np.float64]] = np.mean
) -> Statistics:
    """Mean, median, and the interval of ``average``, ``np.mean`` or ``np.median``, as :func:`interval` has it."""
    if not len(values):
        return Statistics(None, None, None, None, 0)
    array = np.array(values, dtype=np.float64)
    return Statistics(float(array.mean()), float(np.median(array)), *interval(array, average), len(array))


def interval(values: NDArray[np.float64], average: Callable[..., NDArray[np.float64]]) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of ``average(values)``, from :data:`RESAMPLES` resamples of fixed seed."""
    resamples = np.random.default_rng(0).choice(values, (RESAMPLES, len(values)))
    low, high = np.quantile(average(resamples, axis=1), (0.025, 0.975))
    return float(low), float(high)


@dataclass(frozen=True)
class Failure:
    """An image without a result of a method (None: of every method), and one sentence why."""

    image: str
    method: str | None
    reason: str


@dataclass(frozen=True)
class Results:
    """The results of all methods on all images: figures by row and image, seconds by method and image, failures.

    Pictures, by row and image, are 8-bit (H, W), of the images that the page shows.
    """

    figures: Mapping[str, Mapping[str, Mapping[str, Any]]]
    seconds: Mapping[str, Mapping[str, float]]
    failures: Sequence[Failure]
    pictures: Mapping[str, Mapping[str, NDArray[np.uint8]]]


def run(
    folder: Path,
    jobs: Mapping[tuple[str, str], Job],
    rows: Mapping[str, Sequence[str]],
    failed: Mapping[str, str],
    shown: Collection[str],
    **options: Any,
) -> Results:
    """The results of jobs, by image and method, as :func:`nablahog.jobs.store.do_all` does them.

    ``rows`` are those of each method, ``failed`` why images could not be read, ``shown`` the images with pictures.
    """
    failures = [Failure(image, None, reason) for image, reason in failed.items()]
    figures: dict[str, dict[str, Mapping[str, Any]]] = {row: {} for method_rows in rows.values() for row in method_rows}
    pictures: dict[str, dict[str, NDArray[np.uint8]]] = {row: {} for row in figures}
    seconds: dict[str, dict[str, float]] = {method: {} for method in rows}
    for (image, method), result in do_all(folder, jobs, label=", ".join, **options):
        if isinstance(result, str):
            failures.append(Failure(image, method, result))
            continue
        seconds[method][image] = result.seconds
        for row, row_figures, picture in zip(rows[method], result.figures, result.pictures, strict=True):
            figures[row][image] = row_figures
            if image in shown:
                pictures[row][image] = picture
    return Results(figures, seconds, failures, pictures)


def spread_evenly(names: Sequence[str], count: int) -> list[str]:
    """At most ``count`` of ``names``, evenly spread over all."""
    count = min(count, len(names))
    return [names[i * len(names) // count] for i in range(count)]


def write_csv(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Writes a table whole or not at all: full precision, None as an empty cell, the names of columns first.

    Texts that a spreadsheet would take for a formula, by their first character, begin with an apostrophe.  Control
    characters in texts are escapes.
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([_cell(value) for value in row] for row in rows)
    write_text(path, text.getvalue())


def _cell(value: object) -> object:
    return guard_formula(printable(value)) if isinstance(value, str) else value


def cell(summary: Statistics, value: float | None, *more: str) -> Cell | None:
    """A figure of a page above its interval and further remarks; None if there are no values."""
    if summary.n == 0:
        return None
    return Cell(value, "\n".join([f"{figure(summary.low)} … {figure(summary.high)}", *more]))


def count_failures(failures: Sequence[Failure]) -> str:
    """The end of the lead of a page; empty if nothing failed."""
    return f" {len(failures)} failed, see below." if failures else ""


def failures_section(failures: Sequence[Failure], image: str, text: str) -> Section:
    """A section that lists the failures; ``image`` heads their images, ``text`` says what they mean for the figures."""
    rows = [{image: failure.image, "method": failure.method or "all", "reason": failure.reason} for failure in failures]
    return Section(f"Failed: {len(rows)}", text, table=rows)
