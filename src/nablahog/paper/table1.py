"""Table 1: every method on every image, and the means over the images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .methods import Method, Table1Settings
from .names import BASELINES, GROUPS, PUBLISHED
from .photographs import Photographs
from .reconstruction import ReconstructionJob
from .tables import Results, Statistics, evenly_spread, run, statistics, write_csv

METRICS = ("cc", "abs_cc", "mi", "ssim", "psnr", "distance")
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
class Table1(Results):
    """All of it.

    Attributes:
        methods: that ran.
        photographs: that they ran on.
    """

    methods: Sequence[Method]
    photographs: Photographs

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
        published = dict(zip(("cc", "mi", "ssim"), PUBLISHED.get(row, ()), strict=False))
        return Line(
            row,
            group,
            {metric: statistics([v for v in of if v is not None]) for metric, of in values.items()},
            {metric: published.get(metric) for metric in METRICS},
            sum(seconds.values()) / len(seconds) if seconds else None,
        )


def run_table1(
    folder: Path, photographs: Photographs, methods: Sequence[Method], settings: Table1Settings, **options: Any
) -> Table1:
    """Runs the jobs without a stored result, as :func:`nablahog.jobs.store.do_all`, and collects all results.

    Args:
        folder: for the results, which exists.
        photographs: the images.
        methods: the methods, of different names.
        settings: for all of them.
        options: ``workers`` and ``progress``, as there.

    Raises:
        ChildProcessError: worker processes do not start.
        OSError: a result cannot be stored.
    """
    jobs = {
        (image, method.name): ReconstructionJob(method, pixels.numpy(), settings)
        for image, pixels in photographs.images.items()
        for method in methods
    }
    rows = {method.name: method.rows for method in methods}
    shown = evenly_spread(list(photographs.images), SHOWN)
    results = run(folder, jobs, rows, photographs.failed, shown, **options)
    return Table1(**vars(results), methods=methods, photographs=photographs)


def write_table1(folder: Path, table: Table1) -> None:
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
