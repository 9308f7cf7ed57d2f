"""Table 1: every method on every image, and the means over the images."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from .. import metrics
from ..io.images import as_array
from ..io.photographs import Photographs
from ..jobs.store import JobResult, digest, make_key
from ..runtime.cache import code_key
from .methods import MethodOutput, ReconstructionMethod, Table1Settings
from .names import GROUPS, PUBLISHED
from .tables import Results, Statistics, run, spread_evenly, statistics, write_csv

METRICS = ("cc", "abs_cc", "mi", "ssim", "psnr", "distance")
SHOWN = 6  # images on the page

Figures: TypeAlias = dict[str, float | None]  # by metric; None where one is not defined


@dataclass(frozen=True)
class ReconstructionJob:
    """One method on one image, (H, W) float32 in 0…1."""

    method: ReconstructionMethod
    image: NDArray[np.float32]
    settings: Table1Settings

    @property
    def folder(self) -> str:
        return self.method.name

    def key(self) -> str:
        """A hash of image, method, settings, and the code that makes the result."""
        settings, method = self.settings, self.method
        facts = {
            "method": method.name,
            "rows": method.rows,
            "spec": None if method.spec is None else method.spec.to_json(),
            "seed": settings.seed,
            "max_evaluations": settings.max_evaluations,
            "learned": [digest(path) for path in self.files()],
            "code": code_key(method.run),
        }
        return make_key(facts, self.image)

    def files(self) -> list[Path]:
        """The learned files that it reads."""
        return [self.settings.learned[kind] for kind in self.method.needs if kind in self.settings.learned]

    def run(self) -> JobResult:
        """Runs the method and compares its outputs with the image: figures and a picture for each of its rows."""
        began = time.perf_counter()
        outputs = self.method.run(torch.from_numpy(self.image)[None, None], self.settings)
        seconds = time.perf_counter() - began
        if len(outputs) != len(self.method.rows):
            raise TypeError(f"expected one output for each of {', '.join(self.method.rows)}, got {len(outputs)}")
        pictures = np.stack([np.rint(as_array(output.image) * 255) for output in outputs])
        return JobResult([_figures(output, self.image) for output in outputs], pictures.astype(np.uint8), seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there are figures and a picture of the image's size for each row."""
        rows, pictures = len(self.method.rows), result.pictures
        whole = pictures.shape == (rows, *self.image.shape) and pictures.dtype == np.uint8
        return whole and len(result.figures) == rows


def _figures(output: MethodOutput, reference: NDArray[np.float32]) -> Figures:
    pair = output.image.detach(), reference
    cc = metrics.cross_correlation(*pair)
    values = (cc, abs(cc), metrics.mutual_information(*pair), metrics.ssim(*pair), metrics.psnr(*pair), output.distance)
    # JSON knows no NaN and no infinity
    return {name: value if np.isfinite(value) else None for name, value in zip(METRICS, values, strict=True)}


@dataclass(frozen=True)
class Table1Row:
    """A row of the table: statistics by metric, and the means that the paper prints.

    MI has statistics only of images of one number of pixels, on which its bias depends.  ``seconds`` is the mean time
    for an image; None for levels, and for methods that failed on all images.
    """

    row: str
    group: str
    statistics: Mapping[str, Statistics]
    paper: Mapping[str, float | None]
    seconds: float | None


@dataclass(frozen=True)
class Table1(Results):
    """The results of the methods that ran on some photographs."""

    methods: Sequence[ReconstructionMethod]
    photographs: Photographs

    def table_rows(self) -> list[Table1Row]:
        """The table of the methods that ran, group by group."""
        return [
            self._table_row(row, group)
            for group in GROUPS
            for method in self.methods
            if method.group == group
            for row in method.rows
        ]

    def _table_row(self, row: str, group: str) -> Table1Row:
        figures, seconds = self.figures.get(row, {}), self.seconds.get(row, {})
        values = {metric: [measures[metric] for measures in figures.values()] for metric in METRICS}
        if not self.photographs.equally_large:
            values["mi"] = []
        published = dict(zip(("cc", "mi", "ssim"), PUBLISHED.get(row, ()), strict=False))
        return Table1Row(
            row,
            group,
            {metric: statistics([v for v in column if v is not None]) for metric, column in values.items()},
            {metric: published.get(metric) for metric in METRICS},
            sum(seconds.values()) / len(seconds) if seconds else None,
        )


def run_table1(
    folder: Path,
    photographs: Photographs,
    methods: Sequence[ReconstructionMethod],
    settings: Table1Settings,
    **options: Any,
) -> Table1:
    """The table of some images, whose results are stored in ``folder``.

    Further arguments and errors are those of :func:`nablahog.jobs.store.do_all`.
    """
    jobs = {
        (image, method.name): ReconstructionJob(method, pixels.numpy(), settings)
        for image, pixels in photographs.images.items()
        for method in methods
    }
    rows = {method.name: method.rows for method in methods}
    shown = spread_evenly(list(photographs.images), SHOWN)
    results = run(folder, jobs, rows, photographs.failed, shown, **options)
    return Table1(**vars(results), methods=methods, photographs=photographs)


def write_table1(folder: Path, table: Table1) -> None:
    """Writes ``per_image.csv``, ``summary.csv``, ``times.csv`` and ``failures.csv``.

    Only the times differ between runs of the same settings, however often they were interrupted.
    """
    lines = table.table_rows()
    files: dict[str, list[Sequence[object]]] = {
        "per_image.csv": [("method", "image", *METRICS)],
        "summary.csv": [("method", "metric", "mean", "median", "low", "high", "paper", "n")],
        "times.csv": [("method", "image", "seconds")],
        "failures.csv": [("image", "method", "reason")],
    }
    for line in lines:
        for image, figures in table.figures.get(line.row, {}).items():
            files["per_image.csv"].append((line.row, image, *(figures[metric] for metric in METRICS)))
        for metric, summary in line.statistics.items():
            columns = (summary.mean, summary.median, summary.low, summary.high, line.paper[metric], summary.n)
            files["summary.csv"].append((line.row, metric, *columns))
    for name, seconds in table.seconds.items():
        files["times.csv"] += [(name, image, round(value, 4)) for image, value in seconds.items()]
    files["failures.csv"] += [(failure.image, failure.method, failure.reason) for failure in table.failures]
    for file_name, rows in files.items():
        write_csv(folder / file_name, rows)
