"""Table 2 as files: CSV, and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..io.files import write_text
from .conditions import CONDITIONS
from .pose_methods import Table2Settings
from .table2 import Line, Table2, error_of_azimuth, error_of_rotation
from .tables import Statistics, write_csv


def write_table2(folder: Path, table: Table2, settings: Table2Settings) -> None:
    """Writes ``per_object.csv``, ``summary.csv``, ``rotation.csv``, ``median_error.csv`` and ``failures.csv``.

    If the table has conditions, ``conditions.csv``, too; and ``results.json`` with all but the single objects.
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
            rotation += [(line.method, *row) for row in _rotation(line)]
    write_csv(folder / "summary.csv", summary)
    write_csv(folder / "median_error.csv", median)
    write_csv(folder / "rotation.csv", rotation)
    if table.conditions:
        write_csv(folder / "conditions.csv", _conditions(table))
    else:
        (folder / "conditions.csv").unlink(missing_ok=True)  # of an earlier run in the same folder
    failures = [(failure.image, failure.method, failure.reason) for failure in table.failures]
    write_csv(folder / "failures.csv", [("object", "method", "reason"), *failures])
    write_text(folder / "results.json", json.dumps(_figures(table, settings), indent=2, allow_nan=False) + "\n")


def _rotation(line: Line) -> Iterator[tuple[object, ...]]:
    """Figure, value, low, high of the whole rotation."""
    yield "median_error", line.rotation.median, line.rotation.low, line.rotation.high
    for angle, of in line.within.items():
        yield f"within_{angle:g}_degrees", of.mean, of.low, of.high


def _conditions(table: Table2) -> Iterator[Sequence[object]]:
    yield "condition", "method", "objects", "figure", "value", "low", "high"
    for name in table.conditions:
        for line in table.under(name).ran():
            first = (name, line.method, line.error.n)
            for (criterion, views), of in line.accuracy.items():
                yield *first, f"{criterion}_{views}", of.mean, of.low, of.high
            yield *first, "azimuth_median_error", line.error.median, line.error.low, line.error.high
            for figure, *values in _rotation(line):
                yield *first, f"rotation_{figure}", *values


def _per_object(table: Table2) -> list[Sequence[object]]:
    pose = ("azimuth", "elevation", "distance", "theta")
    truth = ("true_azimuth", "true_elevation", "true_theta")
    heads = ("object", "model", "method", *truth, *pose, "found_model", "error", "rotation_error", "seconds")
    rows: list[Sequence[object]] = [heads]
    for method, of in table.figures.items():
        for each in table.all_objects():
            if each.name in of:
                outcome = of[each.name]
                true = (each.name, each.model, method, each.azimuth, each.elevation, each.theta)
                values = (outcome[name] for name in pose)
                errors = error_of_azimuth(outcome, each), error_of_rotation(outcome, each)
                seconds = round(table.seconds[method][each.name], 4)
                rows.append((*true, *values, outcome["model"], *errors, seconds))
    return rows


def _figures(table: Table2, settings: Table2Settings) -> dict[str, Any]:
    """Both tables, ready for JSON."""
    return {
        "origin": table.examples.origin,
        "seed": settings.seed,
        "table": [_line(line) for line in table.lines()],
        "conditions": {
            name: {
                "about": CONDITIONS[name].about,
                "table": [_line(line) for line in table.under(name).ran()],
            }
            for name in table.conditions
        },
        "failures": [vars(failure) for failure in table.failures],
        "methods": {method.name: method.about for method in table.methods},
        "units": "accuracies in percent, errors in degrees; low, high: their interval of 95 %",
        "version": version("nablahog"),
    }


def _line(line: Line) -> dict[str, Any]:
    accuracy: dict[str, dict[str, Any]] = {}
    for (criterion, views), of in line.accuracy.items():
        accuracy.setdefault(criterion, {})[str(views)] = _mean(of)
    return {
        "method": line.method,
        "objects": line.error.n,
        **accuracy,
        "median_error": _median(line.error),
        "rotation": {
            "median_error": _median(line.rotation),
            **{f"within_{angle:g}_degrees": _mean(of) for angle, of in line.within.items()},
        },
        "paper": {str(views): value for views, value in line.paper.items()},
    }


def _mean(of: Statistics) -> Mapping[str, float | None]:
    return {"value": of.mean, "low": of.low, "high": of.high}


def _median(of: Statistics) -> Mapping[str, float | None]:
    return {"value": of.median, "low": of.low, "high": of.high}
