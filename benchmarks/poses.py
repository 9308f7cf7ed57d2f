"""What each choice of a search for the pose gains and costs: accuracy, renderings and time an object.

    python benchmarks/poses.py [--models DIR] [--viewpoints CSV] [--objects 60] [--seed 0] [--threads 2]
        [--unknown-model] [--rows 'NAME;…'] [--growth]

The objects are those of `nablahog table2` with the same options: scenes of known models, or among all others, from a
random azimuth and an elevation near the true one, unless a row says that it is unknown.  Times are those of
`nablahog.estimate_pose` alone, for models that have been prepared: in the second of two passes over all objects.  The
last column is of the first, in which models are simplified and their views all around rendered.
With --growth the table is of the time by the number of models to choose among, which are not the object's own.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import VIEWS, azimuth_error, same_view
from nablahog.paper.examples import Example, rendered
from nablahog.paper.models import models_in, procedural_chairs
from nablahog.paper.viewpoints import read_viewpoints, sample_viewpoints
from nablahog.pose import PoseEstimate, coarse_to_fine, estimate_pose
from nablahog.pose.ascent import SCHEDULE, Round

ROWS: dict[str, dict[str, Any]] = {
    "best": {},
    "best, elevation unknown": {"initial": None},
    "best, whitened elements": {"similarity": "whitened"},
    "best, patches": {"similarity": "patches"},
    "best, 6 values for 4 slopes": {},
    "best, 12 values for 4 slopes": {},
    "best, by L-BFGS": {"ascent": "lbfgs"},
    "best, by momentum": {"ascent": "momentum"},
    "exhaustive": {"method": "exhaustive"},
    "exhaustive, patches": {"method": "exhaustive", "similarity": "patches"},
    "paper": {"method": "paper"},
    "paper-edges": {"method": "paper-edges"},
    "paper, whitened elements": {"method": "paper", "similarity": "whitened"},
    "paper, calibrated": {"method": "paper", "similarity": "calibrated"},
}
SCHEDULES = {
    "best, 6 values for 4 slopes": tuple(Round(6, of.spread, slopes=False) if of.slopes else of for of in SCHEDULE),
    "best, 12 values for 4 slopes": tuple(Round(12, spread, slopes=False) for spread in (0.8, 0.7, 0.6, 0.6)),
}
"""Of rows whose quadratic ascent has values only; the second has a round less, for the same time."""


def objects(
    count: int, models: Path | None, viewpoints: Path | None = None, *, unknown_model: bool = False, seed: int = 0
) -> list[Example]:
    """So many scenes of the models of a folder, or procedural ones, from the viewpoints of a file, or random ones."""
    chairs = procedural_chairs(24) if models is None else models_in(models)[0]
    angles = (
        sample_viewpoints(10_000, np.random.default_rng(seed)) if viewpoints is None else read_viewpoints(viewpoints)
    )
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    return rendered(count, chairs, angles, clutter, origin="", unknown_model=unknown_model, seed=seed).objects


def add_options(parser: argparse.ArgumentParser, threads: int) -> None:
    """Adds those that choose the objects, and the number of threads."""
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default procedural chairs")
    parser.add_argument("--viewpoints", type=Path, help="CSV of azimuth and elevation; by default drawn at random")
    parser.add_argument("--objects", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=threads)
    parser.add_argument("--unknown-model", action="store_true", help="leave an object's own model out")


def objects_of(options: argparse.Namespace) -> list[Example]:
    """The objects that the options of :func:`add_options` choose."""
    return objects(
        options.objects, options.models, options.viewpoints, unknown_model=options.unknown_model, seed=options.seed
    )


def estimate(example: Example, choices: dict[str, Any]) -> PoseEstimate:
    models = {model.name: model.mesh() for model in example.models}
    return estimate_pose(example.image, models, box=example.box, **{"initial": example.initial, **choices})


def growth(examples: list[Example]) -> None:
    """Time of the best search among 1, 2, 4, … of the models."""
    print("| models | renderings | CPU s, median (min … max) | CPU ms a model |\n|---:|---:|---:|---:|")
    count = 1
    while count <= len(examples[0].models):
        some = [replace(example, models=example.models[:count]) for example in examples]
        for example in some:
            estimate(example, {})
        cpu, renderings = [], []
        for example in some:
            start = time.process_time()
            renderings.append(estimate(example, {}).renderings)
            cpu.append(time.process_time() - start)
        spread = f"{median(cpu):.3f} ({min(cpu):.3f} … {max(cpu):.3f})"
        print(f"| {count} | {median(renderings):.0f} | {spread} | {1e3 * median(cpu) / count:.0f} |", flush=True)
        count *= 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_options(parser, threads=2)
    parser.add_argument("--rows", help="only these, separated by semicolons")
    parser.add_argument("--growth", action="store_true", help="time by the number of models instead")
    options = parser.parse_args()
    options.unknown_model |= options.growth
    torch.set_num_threads(options.threads)
    examples = objects_of(options)
    rows = ROWS if options.rows is None else {name: ROWS[name] for name in options.rows.split(";")}
    print(f"{len(examples)} objects, seed {options.seed}, {options.threads} threads\n")
    if options.growth:
        growth(examples)
        return
    views = " | ".join(f"{count} views" for count in VIEWS)
    print(f"| search | {views} | median error | renderings | s, median (min … max) | CPU s, median | first pass |")
    print("|---|" + "---:|" * (len(VIEWS) + 5))
    estimate(examples[0], {})  # so that all loops are compiled
    for name, choices in rows.items():
        vars(coarse_to_fine)["SCHEDULE"] = SCHEDULES.get(name, SCHEDULE)
        first = []
        for example in examples:
            start = time.process_time()
            estimate(example, choices)
            first.append(time.process_time() - start)
        right, errors, renderings, wall, cpu = [], [], [], [], []
        for example in examples:
            clocks = time.perf_counter(), time.process_time()
            result = estimate(example, choices)
            wall.append(time.perf_counter() - clocks[0])
            cpu.append(time.process_time() - clocks[1])
            right.append([bool(same_view(result.azimuth, example.azimuth, count)) for count in VIEWS])
            errors.append(float(azimuth_error(result.azimuth, example.azimuth)))
            renderings.append(result.renderings)
        shares = " | ".join(f"{100 * sum(column) / len(examples):.1f}" for column in zip(*right, strict=True))
        times = f"{median(wall):.3f} ({min(wall):.3f} … {max(wall):.3f}) | {median(cpu):.3f} | {median(first):.3f}"
        print(f"| {name} | {shares} | {median(errors):.2f}° | {median(renderings):.0f} | {times} |", flush=True)


if __name__ == "__main__":
    main()
