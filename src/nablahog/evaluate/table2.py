"""Table 2: every method on every object, and how often the viewpoint is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..metrics import VIEWS, azimuth_error, near_view, rotation_error, same_view
from .examples import Example, Examples
from .names import POSE_PUBLISHED
from .pose_job import PoseJob
from .pose_methods import PoseMethod, Table2Settings
from .tables import Results, Statistics, run, statistics, write_csv

CRITERIA = {"interval": same_view, "threshold": near_view}
WITHIN = (30.0, 10.0)  # degrees of the rotation's error: π/6 and π/18, by which the field reports poses
NO_POSE = 180.0  # degrees: the errors where a method has no pose
SHOWN = 9  # objects whose pictures are kept for the page, as many as the paper shows


@dataclass(frozen=True)
class Line:
    """A row of the table: ours and the paper's.

    Attributes:
        method: its name.
        accuracy: percent of the objects, by criterion and number of views.
        error: of the azimuth in degrees, with the interval of the median.
        rotation: likewise, of the whole rotation.
        within: percent of the objects whose rotation is off by no more than each of :data:`WITHIN`.
        paper: published accuracies in percent by the number of views.
        seconds: median time for an object; None if the method did not run, or has no pose.
    """

    method: str
    accuracy: Mapping[tuple[str, int], Statistics]
    error: Statistics
    rotation: Statistics
    within: Mapping[float, Statistics]
    paper: Mapping[int, float]
    seconds: float | None


@dataclass(frozen=True)
class Table2(Results):
    """All of it: figures are those of a :class:`.pose_methods.PoseOutcome`, pictures are silhouettes.

    Attributes:
        methods: that ran, each with the row of its name.
        examples: that they ran on.
    """

    methods: Sequence[PoseMethod]
    examples: Examples

    def lines(self) -> list[Line]:
        """The table: what is published of methods that did not run, then the methods that ran."""
        ran = [method.name for method in self.methods]
        return [self._line(name) for name in [*(name for name in POSE_PUBLISHED if name not in ran), *ran]]

    def errors(self, method: str) -> NDArray[np.float64]:
        """The errors of a method's azimuths in degrees, :data:`NO_POSE` where it has none, in the order of objects."""
        figures = self.figures[method]
        return np.array([_error(figures.get(each.name), each) for each in self.examples.objects])

    def rotation_errors(self, method: str) -> NDArray[np.float64]:
        """The errors of a method's rotations, as :meth:`errors`."""
        figures = self.figures[method]
        return np.array([_rotation_error(figures.get(each.name), each) for each in self.examples.objects])

    def _line(self, name: str) -> Line:
        figures, seconds = self.figures.get(name, {}), self.seconds.get(name, {})
        objects = self.examples.objects if name in self.figures else []
        accuracy = {
            (criterion, views): statistics(
                [100.0 * _right(criterion, views, figures.get(each.name), each) for each in objects]
            )
            for criterion in CRITERIA
            for views in VIEWS
        }
        none: NDArray[np.float64] = np.empty(0)
        errors, rotations = (self.errors(name), self.rotation_errors(name)) if objects else (none, none)
        within = {angle: statistics([100.0 * float(error <= angle) for error in rotations]) for angle in WITHIN}
        typical = float(np.median(list(seconds.values()))) if seconds else None
        return Line(
            method=name,
            accuracy=accuracy,
            error=statistics(errors, np.median),
            rotation=statistics(rotations, np.median),
            within=within,
            paper=POSE_PUBLISHED.get(name, {}),
            seconds=typical,
        )


def _error(pose: Mapping[str, Any] | None, example: Example) -> float:
    return NO_POSE if pose is None else float(azimuth_error(pose["azimuth"], example.azimuth))


def _rotation_error(pose: Mapping[str, Any] | None, example: Example) -> float:
    if pose is None:
        return NO_POSE
    truth = example.azimuth, example.elevation, example.theta
    return float(rotation_error([pose["azimuth"], pose["elevation"], pose["theta"]], truth))


def _right(criterion: str, views: int, pose: Mapping[str, Any] | None, example: Example) -> bool:
    return pose is not None and bool(CRITERIA[criterion](pose["azimuth"], example.azimuth, views))


def run_table2(
    folder: Path, examples: Examples, methods: Sequence[PoseMethod], settings: Table2Settings, **options: Any
) -> Table2:
    """Runs what has no stored result yet, see :func:`nablahog.jobs.resume.do_all`, and collects all results.

    Args:
        folder: for the results, which exists.
        examples: the objects.
        methods: the methods, of different names.
        settings: for all of them.
        options: ``workers`` and ``progress``, as there.

    Raises:
        ChildProcessError: worker processes do not start.
        OSError: a result cannot be stored, or a model cannot be read.
    """
    jobs = {
        (each.name, method.name): PoseJob(method, each.image.numpy(), each.box, each.models, each.initial, settings)
        for each in examples.objects
        for method in methods
    }
    rows = {method.name: (method.name,) for method in methods}
    results = run(folder, jobs, rows, examples.failed, SHOWN, **options)
    return Table2(**vars(results), methods=methods, examples=examples)


def write_table2(folder: Path, table: Table2) -> None:
    """Writes ``per_object.csv``, ``summary.csv``, ``rotation.csv``, ``median_error.csv`` and ``failures.csv``.

    Accuracies are in percent, errors in degrees.
    Only the seconds in the first differ between runs of the same settings, however often they were interrupted.
    """
    write_csv(folder / "per_object.csv", _per_object(table))
    summary: list[Sequence[object]] = [("method", "criterion", "views", "accuracy", "low", "high", "paper")]
    median: list[Sequence[object]] = [("method", "objects", "median_error", "low", "high")]
    rotation: list[Sequence[object]] = [("method", "figure", "value", "low", "high")]
    for line in table.lines():
        for (criterion, views), of in line.accuracy.items():
            paper = line.paper.get(views) if criterion == "interval" else None
            summary.append((line.method, criterion, views, of.mean, of.low, of.high, paper))
        if line.error.n:
            median.append((line.method, line.error.n, line.error.median, line.error.low, line.error.high))
            rotation.append((line.method, "median_error", line.rotation.median, line.rotation.low, line.rotation.high))
            rotation += [
                (line.method, f"within_{angle:g}_degrees", of.mean, of.low, of.high)
                for angle, of in line.within.items()
            ]
    write_csv(folder / "summary.csv", summary)
    write_csv(folder / "median_error.csv", median)
    write_csv(folder / "rotation.csv", rotation)
    failures = [(failure.image, failure.method, failure.reason) for failure in table.failures]
    write_csv(folder / "failures.csv", [("object", "method", "reason"), *failures])


def _per_object(table: Table2) -> list[Sequence[object]]:
    pose = ("azimuth", "elevation", "distance", "theta")
    truth = ("true_azimuth", "true_elevation", "true_theta")
    heads = ("object", "model", "method", *truth, *pose, "found_model", "error", "rotation_error", "seconds")
    rows: list[Sequence[object]] = [heads]
    for method, of in table.figures.items():
        for each in table.examples.objects:
            if each.name in of:
                outcome = of[each.name]
                true = (each.name, each.model, method, each.azimuth, each.elevation, each.theta)
                values = (outcome[name] for name in pose)
                errors = _error(outcome, each), _rotation_error(outcome, each)
                seconds = round(table.seconds[method][each.name], 4)
                rows.append((*true, *values, outcome["model"], *errors, seconds))
    return rows
