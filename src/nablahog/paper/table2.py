"""Table 2: every method on every object, and how often the viewpoint is right; the same under harder conditions."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..inputs.boxes import Box
from ..io.images import as_array
from ..jobs.store import JobResult, digest, make_key
from ..jobs.worker import local_path
from ..metrics import VIEW_COUNTS, azimuth_error, near_view, rotation_error, same_view
from ..render.models import Model
from ..runtime.cache import code_key
from .annotations import Example
from .examples import Examples
from .names import POSE_PUBLISHED
from .pose_methods import PoseInput, PoseMethod, PoseOutcome, Table2Settings, coverage
from .tables import Results, Statistics, run, spread_evenly, statistics, write_csv

CRITERIA = {"interval": same_view, "threshold": near_view}
WITHIN = (30.0, 10.0)  # degrees of the rotation's error: π/6 and π/18, by which the field reports poses
NO_POSE = 180.0  # degrees: the errors where a method has no pose
SHOWN = 9  # objects whose pictures are kept for the page, as many as the paper shows


@dataclass(frozen=True, eq=False)
class PoseJob:
    """One method on one object: a problem, whose image is an array (C, H, W), float32 in 0…1, and the settings."""

    method: PoseMethod
    image: NDArray[np.float32]
    box: Box | None
    models: tuple[Model, ...]
    initial: tuple[float, float] | None
    settings: Table2Settings

    @property
    def folder(self) -> str:
        return self.method.name

    def key(self) -> str:
        """A hash of the problem, the method, the settings, and the code that makes the result."""
        facts = {
            "method": self.method.name,
            "box": self.box,
            "models": [[model.name, digest(model.file)] for model in self.models],
            "initial": self.initial,
            "seed": self.settings.seed,
            "code": code_key(self.method.run, *filter(None, [self.method.prepare])),
        }
        return make_key(facts, self.image)

    def files(self) -> list[Path]:
        return [model.file for model in self.models]

    def run(self) -> JobResult:
        """Runs the method: the pose as figures, its silhouette as the picture; the time is without preparation."""
        meshes = {model.name: model.mesh(local_path(model.file)) for model in self.models}
        problem = PoseInput(torch.from_numpy(self.image), self.box, meshes, self.initial)
        if self.method.prepare is not None:
            self.method.prepare(problem, self.settings)
        began = time.perf_counter()
        outcome = self.method.run(problem, self.settings)
        seconds = time.perf_counter() - began
        figures = asdict(outcome)
        if not all(math.isfinite(value) for value in figures.values() if not isinstance(value, str)):
            raise ValueError(f"the pose is not finite: {figures}")
        silhouette = np.rint(as_array(coverage(problem, outcome)).clip(0, 1) * 255)
        return JobResult([figures], silhouette[None].astype(np.uint8), seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there is a pose, and a silhouette of the image's size."""
        poses = [set(figures) == {field.name for field in fields(PoseOutcome)} for figures in result.figures]
        pictures = result.pictures
        return poses == [True] and pictures.shape == (1, *self.image.shape[1:]) and pictures.dtype == np.uint8


@dataclass(frozen=True)
class Table2Row:
    """A row of the table.

    Attributes:
        accuracy, paper: percent of the objects, ours by criterion and number of views, published by number of views.
        error, rotation: of the azimuth and of the whole rotation in degrees, with the interval of the median.
        within: percent of the objects whose rotation is off by no more than each of :data:`WITHIN`.
        seconds: median time for an object; None if the method has no pose.
    """

    method: str
    accuracy: Mapping[tuple[str, int], Statistics]
    error: Statistics
    rotation: Statistics
    within: Mapping[float, Statistics]
    paper: Mapping[int, float]
    seconds: float | None

    def figures(self) -> Iterator[tuple[str, float | None, float | None, float | None, float | None]]:
        """Name, value, low, high and the paper's value of each figure."""
        for (criterion, views), summary in self.accuracy.items():
            paper = self.paper.get(views) if criterion == "interval" else None
            yield f"{criterion}_{views}", summary.mean, summary.low, summary.high, paper
        yield "median_error", self.error.median, self.error.low, self.error.high, None
        yield "rotation_median_error", self.rotation.median, self.rotation.low, self.rotation.high, None
        for angle, summary in self.within.items():
            yield f"rotation_within_{angle:g}_degrees", summary.mean, summary.low, summary.high, None


@dataclass(frozen=True)
class Table2(Results):
    """The results of the methods that ran on some objects, and on the same or others under harder conditions, by name.

    Figures are those of a :class:`.pose_methods.PoseOutcome`, pictures are silhouettes.
    """

    methods: Sequence[PoseMethod]
    examples: Examples
    conditions: Mapping[str, Examples] = field(default_factory=dict)

    def under(self, condition: str) -> Table2:
        """The table of one of the conditions."""
        return replace(self, examples=self.conditions[condition], conditions={})

    def all_objects(self) -> Iterator[Example]:
        """The objects of the table and of all conditions."""
        for examples in (self.examples, *self.conditions.values()):
            yield from examples.objects

    def table_rows(self) -> list[Table2Row]:
        """The table of the methods that ran."""
        return [self._table_row(method.name) for method in self.methods]

    def _table_row(self, name: str) -> Table2Row:
        figures, clocks = self.figures[name], self.seconds[name]
        objects = self.examples.objects
        poses = [(figures.get(example.name), example) for example in objects]
        accuracy = {
            (criterion, views): statistics([100.0 * _right(criterion, views, *pair) for pair in poses])
            for criterion in CRITERIA
            for views in VIEW_COUNTS
        }
        errors, rotations = ([error(*pair) for pair in poses] for error in (error_of_azimuth, error_of_rotation))
        within = {angle: statistics([100.0 * float(error <= angle) for error in rotations]) for angle in WITHIN}
        seconds = [clocks[example.name] for example in objects if example.name in clocks]
        return Table2Row(
            method=name,
            accuracy=accuracy,
            error=statistics(errors, np.median),
            rotation=statistics(rotations, np.median),
            within=within,
            paper=POSE_PUBLISHED.get(name, {}),
            seconds=float(np.median(seconds)) if seconds else None,
        )


def error_of_azimuth(pose: Mapping[str, Any] | None, example: Example) -> float:
    """Degrees by which the azimuth of a method's figures is off; :data:`NO_POSE` without figures."""
    return NO_POSE if pose is None else float(azimuth_error(pose["azimuth"], example.azimuth))


def error_of_rotation(pose: Mapping[str, Any] | None, example: Example) -> float:
    """Degrees by which the whole rotation of a method's figures is off; :data:`NO_POSE` without figures."""
    if pose is None:
        return NO_POSE
    truth = example.azimuth, example.elevation, example.theta
    return float(rotation_error([pose["azimuth"], pose["elevation"], pose["theta"]], truth))


def _right(criterion: str, views: int, pose: Mapping[str, Any] | None, example: Example) -> bool:
    return pose is not None and bool(CRITERIA[criterion](pose["azimuth"], example.azimuth, views))


def run_table2(
    folder: Path,
    examples: Examples,
    methods: Sequence[PoseMethod],
    settings: Table2Settings,
    conditions: Mapping[str, Examples] | None = None,
    **options: Any,
) -> Table2:
    """The table of some objects, and of others under harder conditions, by name; all objects have different names.

    Results are stored in ``folder``; further arguments and errors are those of :func:`nablahog.jobs.store.do_all`.

    Raises:
        OSError: a model cannot be read.
    """
    harder = conditions or {}
    everything = [example for some in (examples, *harder.values()) for example in some.objects]
    jobs = {
        (example.name, method.name): PoseJob(
            method, example.image.numpy(), example.box, example.candidates, example.initial, settings
        )
        for example in everything
        for method in methods
    }
    rows = {method.name: (method.name,) for method in methods}
    shown = spread_evenly([example.name for example in examples.objects], SHOWN)
    results = run(folder, jobs, rows, examples.failed, shown, **options)
    return Table2(**vars(results), methods=methods, examples=examples, conditions=harder)


def write_table2(folder: Path, table: Table2) -> None:
    """Writes ``summary.csv``, ``per_object.csv`` and ``failures.csv``.

    Accuracies are in percent, errors in degrees.  Rows of the table itself have no condition.  Only the seconds differ
    between runs of the same settings, however often they were interrupted.
    """
    summary: list[Sequence[object]] = [
        ("condition", "method", "objects", "figure", "value", "low", "high", "paper"),
        *(("", line.method, line.error.n, *figure) for line in table.table_rows() for figure in line.figures()),
    ]
    for name in table.conditions:
        for line in table.under(name).table_rows():
            for *figure, _ in line.figures():  # the paper has none of them
                summary.append((name, line.method, line.error.n, *figure, None))
    write_csv(folder / "summary.csv", summary)
    write_csv(folder / "per_object.csv", _per_object(table))
    failures = [(failure.image, failure.method, failure.reason) for failure in table.failures]
    write_csv(folder / "failures.csv", [("object", "method", "reason"), *failures])


def _per_object(table: Table2) -> Iterator[Sequence[object]]:
    pose = ("azimuth", "elevation", "distance", "theta")
    truth = ("true_azimuth", "true_elevation", "true_theta")
    yield "object", "model", "method", *truth, *pose, "found_model", "error", "rotation_error", "seconds"
    for method, figures in table.figures.items():
        for example in table.all_objects():
            if example.name in figures:
                outcome = figures[example.name]
                yield (
                    *(example.name, example.model, method, example.azimuth, example.elevation, example.theta),
                    *(outcome[name] for name in pose),
                    outcome["model"],
                    *(error_of_azimuth(outcome, example), error_of_rotation(outcome, example)),
                    round(table.seconds[method][example.name], 4),
                )
