"""Table 2: every method on every object, and how often the viewpoint is right."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..jobs.resume import do_all
from ..metrics import VIEWS, azimuth_error, near_view, same_view
from .examples import Example, Examples
from .pose_job import PoseJob
from .pose_methods import PoseMethod, PoseOutcome, Table2Settings
from .published import POSE_PUBLISHED
from .statistics import Statistics, interval, statistics
from .tables import Failure, evenly_spread, write_csv

CRITERIA = {"interval": same_view, "threshold": near_view}
NO_POSE = 180.0  # degrees: the error where a method has no pose
SHOWN = 9  # objects whose pictures are kept for the page, as many as the paper shows


@dataclass(frozen=True)
class Median:
    """The median error in degrees and its 95 % interval; None if there are no objects."""

    value: float | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Line:
    """A row of the table: ours and the paper's.

    Attributes:
        method: its name.
        accuracy: percent of the objects, by criterion and number of views.
        error: of the azimuth.
        paper: published accuracies in percent by the number of views.
        seconds: median time for an object; None if the method did not run, or has no pose.
    """

    method: str
    accuracy: Mapping[tuple[str, int], Statistics]
    error: Median
    paper: Mapping[int, float]
    seconds: float | None


@dataclass(frozen=True)
class Table2:
    """The results of all methods on all objects.

    Attributes:
        methods: that ran.
        examples: that they ran on.
        outcomes: by method and object.
        seconds: by method and object.
        failures: objects without a pose.
        silhouettes: by method and object, 8-bit (H, W), of :data:`SHOWN` objects.
    """

    methods: Sequence[PoseMethod]
    examples: Examples
    outcomes: Mapping[str, Mapping[str, PoseOutcome]]
    seconds: Mapping[str, Mapping[str, float]]
    failures: Sequence[Failure]
    silhouettes: Mapping[str, Mapping[str, NDArray[np.uint8]]]

    def lines(self) -> list[Line]:
        """The table: what is published of methods that did not run, then the methods that ran."""
        ran = [method.name for method in self.methods]
        return [self._line(name) for name in [*(name for name in POSE_PUBLISHED if name not in ran), *ran]]

    def errors(self, method: str) -> NDArray[np.float64]:
        """The errors of a method's azimuths in degrees, :data:`NO_POSE` where it has none, in the order of objects."""
        outcomes = self.outcomes[method]
        return np.array([_error(outcomes.get(each.name), each) for each in self.examples.objects])

    def _line(self, name: str) -> Line:
        outcomes, seconds = self.outcomes.get(name, {}), self.seconds.get(name, {})
        objects = self.examples.objects if name in self.outcomes else []
        accuracy = {
            (criterion, views): statistics(
                [100.0 * _right(criterion, views, outcomes.get(each.name), each) for each in objects]
            )
            for criterion in CRITERIA
            for views in VIEWS
        }
        error = Median()
        if objects:
            errors = self.errors(name)
            error = Median(float(np.median(errors)), *interval(errors, np.median))
        typical = float(np.median(list(seconds.values()))) if seconds else None
        return Line(name, accuracy, error, POSE_PUBLISHED.get(name, {}), typical)


def _error(outcome: PoseOutcome | None, example: Example) -> float:
    return NO_POSE if outcome is None else float(azimuth_error(outcome.azimuth, example.azimuth))


def _right(criterion: str, views: int, outcome: PoseOutcome | None, example: Example) -> bool:
    return outcome is not None and bool(CRITERIA[criterion](outcome.azimuth, example.azimuth, views))


def run_table2(
    folder: Path,
    examples: Examples,
    methods: Sequence[PoseMethod],
    settings: Table2Settings,
    *,
    workers: int,
    progress: Callable[[int, int, str], None] = lambda done, total, at_work: None,
) -> Table2:
    """Runs what has no stored result yet, see :func:`nablahog.jobs.resume.do_all`, and collects all results.

    Args:
        folder: for the results, which exists.
        examples: the objects.
        methods: the methods, of different names.
        settings: for all of them.
        workers: processes to work in.
        progress: called with what is done, the total, and the methods at work.

    Raises:
        ChildProcessError: worker processes do not start.
        OSError: a result cannot be stored, or a model cannot be read.
    """
    jobs = {
        (each.name, method.name): PoseJob(method, each.image.numpy(), each.box, each.models, each.initial, settings)
        for each in examples.objects
        for method in methods
    }
    failures = [Failure(name, None, reason) for name, reason in examples.failed.items()]
    shown = evenly_spread([each.name for each in examples.objects], SHOWN)
    outcomes: dict[str, dict[str, PoseOutcome]] = {method.name: {} for method in methods}
    seconds: dict[str, dict[str, float]] = {method.name: {} for method in methods}
    silhouettes: dict[str, dict[str, NDArray[np.uint8]]] = {method.name: {} for method in methods}
    for (name, method), result in do_all(folder, jobs, workers=workers, progress=progress):
        if isinstance(result, str):
            failures.append(Failure(name, method, result))
            continue
        outcomes[method][name] = PoseOutcome(**result.figures[0])
        seconds[method][name] = result.seconds
        if name in shown:
            silhouettes[method][name] = result.pictures[0]
    return Table2(methods, examples, outcomes, seconds, failures, silhouettes)


def write_tables(folder: Path, table: Table2) -> None:
    """Writes ``per_object.csv``, ``summary.csv``, ``median_error.csv`` and ``failures.csv``; accuracies in percent.

    Only the seconds in the first differ between runs of the same settings, however often they were interrupted.
    """
    write_csv(folder / "per_object.csv", _per_object(table))
    summary: list[Sequence[object]] = [("method", "criterion", "views", "accuracy", "low", "high", "paper")]
    median: list[Sequence[object]] = [("method", "objects", "median_error", "low", "high")]
    for line in table.lines():
        for (criterion, views), of in line.accuracy.items():
            paper = line.paper.get(views) if criterion == "interval" else None
            summary.append((line.method, criterion, views, of.mean, of.low, of.high, paper))
        if line.error.value is not None:
            objects = len(table.examples.objects)
            median.append((line.method, objects, line.error.value, line.error.low, line.error.high))
    write_csv(folder / "summary.csv", summary)
    write_csv(folder / "median_error.csv", median)
    failures = [(failure.image, failure.method, failure.reason) for failure in table.failures]
    write_csv(folder / "failures.csv", [("object", "method", "reason"), *failures])


def _per_object(table: Table2) -> list[Sequence[object]]:
    pose = ("azimuth", "elevation", "distance", "theta")
    heads = ("object", "model", "method", "true_azimuth", "true_elevation", *pose, "found_model", "error", "seconds")
    rows: list[Sequence[object]] = [heads]
    for method, of in table.outcomes.items():
        for each in table.examples.objects:
            outcome = of.get(each.name)
            if outcome is not None:
                truth = (each.name, each.model, method, each.azimuth, each.elevation)
                values = (getattr(outcome, name) for name in pose)
                seconds = round(table.seconds[method][each.name], 4)
                rows.append((*truth, *values, outcome.model, _error(outcome, each), seconds))
    return rows
