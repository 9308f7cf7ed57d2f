"""How often is the pose right, how many renderings does a search take, and how long?

    python benchmarks/poses.py [--models DIR] [--viewpoints CSV] [--objects 60] [--seed 0] [--threads 1]
        [--unknown-model] [--methods best exhaustive paper] [--conditions larger-20 no-box …] [--growth]

The objects are those of `nablahog table2` with the same options: scenes of known models, or among all others, from a
random azimuth and an elevation near the true one.  Times are those of `nablahog.estimate_pose` alone, for models that
have been prepared: in the second of two passes over all objects.  The last column is of the first pass, in which models
are simplified and their views all around rendered.  With --growth the table is of the time by the number of models to
choose among, which are not the object's own.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nablahog import PoseEstimate, estimate_pose
from nablahog.io.images import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import VIEWS, azimuth_error, same_view
from nablahog.paper.annotations import AnnotatedObject, read_viewpoints, sample_viewpoints
from nablahog.paper.examples import rendered
from nablahog.paper.models import models_in, scene_chairs
from timing import Summary, digits, summary, table

WITHIN = 15.0  # degrees of azimuth


def objects(
    count: int,
    models: Path | None = None,
    viewpoints: Path | None = None,
    *,
    unknown_model: bool = False,
    seed: int = 0,
    condition: str = "",
) -> list[AnnotatedObject]:
    """So many scenes of the models of a folder, or of chairs that ship, from the viewpoints of a file, or random."""
    chairs = scene_chairs() if models is None else models_in(models)[0]
    angles = (
        sample_viewpoints(10_000, np.random.default_rng(seed)) if viewpoints is None else read_viewpoints(viewpoints)
    )
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    some = rendered(
        count, chairs, angles, clutter, origin="", unknown_model=unknown_model, seed=seed, condition=condition
    )
    return some.objects


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds those that choose the objects, and the number of threads."""
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default chairs that ship")
    parser.add_argument("--viewpoints", type=Path, help="CSV of azimuth and elevation; by default drawn at random")
    parser.add_argument("--objects", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--unknown-model", action="store_true", help="leave an object's own model out")


def objects_of(options: argparse.Namespace, condition: str = "") -> list[AnnotatedObject]:
    """The objects that the options of :func:`add_options` choose."""
    return objects(
        options.objects,
        options.models,
        options.viewpoints,
        unknown_model=options.unknown_model,
        seed=options.seed,
        condition=condition,
    )


def estimate(example: AnnotatedObject, choices: dict[str, Any]) -> PoseEstimate:
    models = {model.name: model.mesh() for model in example.candidates}
    return estimate_pose(example.image, models, box=example.box, **{"initial": example.initial, **choices})


def seconds_of(example: AnnotatedObject, choices: dict[str, Any]) -> float:
    """Processor seconds of the second of two searches; the first prepares the models."""
    estimate(example, choices)
    start = time.process_time()
    estimate(example, choices)
    return time.process_time() - start


def timed(examples: Iterable[AnnotatedObject], choices: dict[str, Any]) -> tuple[list[PoseEstimate], Summary]:
    """The results, and a summary of the seconds of the processor."""
    results, seconds = [], []
    for example in examples:
        start = time.process_time()
        results.append(estimate(example, choices))
        seconds.append(time.process_time() - start)
    return results, summary(seconds)


def spread(seconds: Summary) -> str:
    return f"{digits(seconds['median'])} ({digits(seconds['q1'])}…{digits(seconds['q3'])})"


def row(name: str, examples: list[AnnotatedObject], choices: dict[str, Any]) -> list[str]:
    """The table's row of a search on objects."""
    first = timed(examples, choices)[1]
    results, seconds = timed(examples, choices)
    pairs = [(result.azimuth, example.azimuth) for result, example in zip(results, examples, strict=True)]
    shares = [np.mean([bool(same_view(*pair, views)) for pair in pairs]) for views in VIEWS]
    errors = [float(azimuth_error(*pair)) for pair in pairs]
    shares.append(np.mean([error <= WITHIN for error in errors]))
    renderings = np.median([result.renderings for result in results])
    figures = [f"{np.median(errors):.2f}°", f"{renderings:.0f}", spread(seconds), digits(first["median"])]
    return [name, *(f"{100 * share:.1f}" for share in shares), *figures]


def growth(examples: list[AnnotatedObject], methods: list[str]) -> str:
    """Time by the number of models, doubled each time."""
    rows, count = [], 1
    while count <= len(examples[0].candidates):
        some = [replace(example, candidates=example.candidates[:count]) for example in examples]
        for method in methods:
            timed(some, {"method": method})
            results, seconds = timed(some, {"method": method})
            renderings = np.median([result.renderings for result in results])
            a_model = digits(1000 * seconds["median"] / count)
            rows.append([str(count), method, f"{renderings:.0f}", spread(seconds), a_model])
        count *= 2
    return table(["models", "search", "renderings", "CPU s", "CPU ms a model"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    parser.add_argument("--methods", nargs="+", default=["best", "exhaustive", "paper"])
    parser.add_argument("--conditions", nargs="+", default=[""], help="of `nablahog table2 --conditions`")
    parser.add_argument("--growth", action="store_true", help="time by the number of models instead")
    options = parser.parse_args()
    options.unknown_model |= options.growth
    torch.set_num_threads(options.threads)
    print(f"{options.objects} objects, seed {options.seed}, {options.threads} threads\n")
    if options.growth:
        print(growth(objects_of(options), options.methods))
        return
    rows = []
    for condition in options.conditions:
        examples = objects_of(options, condition)
        rows += [row(f"{condition} {method}".strip(), examples, {"method": method}) for method in options.methods]
    views = [f"{count} views" for count in VIEWS]
    figures = ["median error", "renderings", "CPU s", "first pass"]
    print(table(["search", *views, f"within {WITHIN:g}°", *figures], rows))


if __name__ == "__main__":
    main()
