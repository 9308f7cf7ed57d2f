"""Table 1: every method on every image, and the means over the images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..jobs.resume import do_all
from .methods import Method, Table1Settings
from .names import GROUPS
from .photographs import Photographs
from .published import BASELINES, PUBLISHED
from .reconstruction import Figures, ReconstructionJob
from .statistics import Statistics, statistics
from .tables import Failure, evenly_spread, write_csv

METRICS = ("cc", "abs_cc", "mi", "ssim", "distance")
SHOWN = 6  # images on the page


@dataclass(frozen=True)
class Line:
    """A row of the table: ours and the paper's.

    Attributes:
        row: the name of the row.
        group: one of :data:`.names.GROUPS`.
        statistics: by metric.
        paper: published means by metric, None where there are none.
        seconds: mean time for an image; None for levels and for methods that did not run.
    """

    row: str
    group: str
    statistics: Mapping[str, Statistics]
    paper: Mapping[str, float | None]
    seconds: float | None


@dataclass(frozen=True)
class Table1:
    """All of it.

    Attributes:
        methods: that ran.
        photographs: that they ran on.
        figures: by row and image.
        seconds: by method and image.
        failures: images without a result.
        pictures: by row and image, 8-bit (H, W), of :data:`SHOWN` images.
    """

    methods: Sequence[Method]
    photographs: Photographs
    figures: Mapping[str, Mapping[str, Figures]]
    seconds: Mapping[str, Mapping[str, float]]
    failures: Sequence[Failure]
    pictures: Mapping[str, Mapping[str, NDArray[np.uint8]]]

    def lines(self) -> list[Line]:
        """The table, group by group: the paper's baselines that did not run, then the methods that did."""
        ran = {method.name for method in self.methods}
        result = []
        for group in GROUPS:
            rows = [row for row in BASELINES.get(group, ()) if row not in ran]
            rows += [row for method in self.methods if method.group == group for row in method.rows]
            result += [self._line(row, group) for row in rows]
        return result

    def _line(self, row: str, group: str) -> Line:
        figures, seconds = self.figures.get(row, {}), self.seconds.get(row, {})
        values = {metric: [each[metric] for each in figures.values()] for metric in METRICS}
        published = PUBLISHED.get(row)
        return Line(
            row,
            group,
            {metric: statistics([v for v in of if v is not None]) for metric, of in values.items()},
            {metric: getattr(published, metric, None) for metric in METRICS},
            sum(seconds.values()) / len(seconds) if seconds else None,
        )


def run_table1(
    folder: Path,
    photographs: Photographs,
    methods: Sequence[Method],
    settings: Table1Settings,
    *,
    workers: int,
    progress: Callable[[int, int, str], None] = lambda done, total, at_work: None,
) -> Table1:
    """Runs the jobs without a stored result, as :func:`nablahog.jobs.resume.do_all`, and collects all results.

    Args:
        folder: for the results, which exists.
        photographs: the images.
        methods: the methods, of different names.
        settings: for all of them.
        workers: processes to work in.
        progress: called with the number of jobs done, their total, and the methods at work.

    Raises:
        ChildProcessError: worker processes do not start.
        OSError: a result cannot be stored.
    """
    jobs = {
        (image, method.name): ReconstructionJob(method, pixels.numpy(), settings)
        for image, pixels in photographs.images.items()
        for method in methods
    }
    failures = [Failure(image, None, reason) for image, reason in photographs.failed.items()]
    shown = evenly_spread(list(photographs.images), SHOWN)
    figures: dict[str, dict[str, Figures]] = {row: {} for method in methods for row in method.rows}
    pictures: dict[str, dict[str, NDArray[np.uint8]]] = {row: {} for row in figures}
    seconds: dict[str, dict[str, float]] = {method.name: {} for method in methods}
    for (image, name), result in do_all(folder, jobs, workers=workers, progress=progress):
        if isinstance(result, str):
            failures.append(Failure(image, name, result))
            continue
        seconds[name][image] = result.seconds
        rows = jobs[image, name].method.rows
        for row, row_figures, picture in zip(rows, result.figures, result.pictures, strict=True):
            figures[row][image] = dict(row_figures)
            if image in shown:
                pictures[row][image] = picture
    return Table1(methods, photographs, figures, seconds, failures, pictures)


def write_tables(folder: Path, table: Table1) -> None:
    """Writes ``per_image.csv``, ``summary.csv``, ``times.csv`` and ``failures.csv``.

    Only the times differ between runs of the same settings, however often they were interrupted.
    """
    lines = table.lines()
    files: dict[str, list[Sequence[object]]] = {
        "per_image.csv": [("method", "image", *METRICS)],
        "summary.csv": [("method", "metric", "mean", "median", "low", "high", "paper", "n")],
        "times.csv": [("method", "image", "seconds")],
        "failures.csv": [("image", "method", "reason")],
    }
    for line in lines:
        for image, figures in table.figures.get(line.row, {}).items():
            files["per_image.csv"].append((line.row, image, *(figures[metric] for metric in METRICS)))
        for metric, of in line.statistics.items():
            row = (line.row, metric, of.mean, of.median, of.low, of.high, line.paper[metric], of.n)
            files["summary.csv"].append(row)
    for name, seconds in table.seconds.items():
        files["times.csv"] += [(name, image, round(value, 4)) for image, value in seconds.items()]
    files["failures.csv"] += [(failure.image, failure.method, failure.reason) for failure in table.failures]
    for file_name, rows in files.items():
        write_csv(folder / file_name, rows)
