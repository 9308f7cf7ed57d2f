"""How often is the pose right, how many renderings does a search take, and how long?

    python benchmarks/poses.py [--models DIR] [--viewpoints CSV] [--objects 60] [--seed 0] [--threads 1]
        [--unknown-model] [--methods best exhaustive paper] [--conditions larger-20 no-box …] [--growth]

The objects are those of `nablahog table2` with the same options: scenes of known models, or among all others, from a
random azimuth and an elevation near the true one.  Times are those of `nablahog.estimate_pose` alone, for models that
have been prepared: in the second of two passes over all objects.  The last column is of the first pass, in which models
are simplified and their views all around rendered.  With --growth the table is of the time by the number of models to
choose among, which are not the object's own.  With --heights the known chairs that ship have so many pixels, and cast
shadows; with --jitter boxes are off by up to these shares of their sides, five for each scene, which has one answer if
the five azimuths are within 15°.  With --box-only no initial pose is given, and all conditions have the look of
another renderer, with shadows.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nablahog import PoseEstimate, estimate_pose
from nablahog.inputs.boxes import as_box
from nablahog.io.images import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import VIEW_COUNTS, azimuth_error, rotation_error, same_view
from nablahog.paper.annotations import Example, read_viewpoints, sample_viewpoints
from nablahog.paper.examples import CONDITIONS, render_examples
from nablahog.paper.scenes import CHAIRS, SceneSettings, scene
from nablahog.render.models import archived_models, check_models, load_meshes, read_models
from timing import Summary, digits, summary, table

WITHIN = 15.0  # degrees of azimuth
BOXES = 5  # of each scene with --jitter


def objects(
    count: int,
    models: Path | None = None,
    viewpoints: Path | None = None,
    *,
    unknown_model: bool = False,
    seed: int = 0,
    condition: str = "",
    box_only: bool = False,
) -> list[Example]:
    """So many scenes of the models of a folder, or of chairs that ship, from the viewpoints of a file, or random."""
    chairs = archived_models(CHAIRS) if models is None else check_models(read_models(models)[0])[0]
    angles = (
        sample_viewpoints(10_000, np.random.default_rng(seed)) if viewpoints is None else read_viewpoints(viewpoints)
    )
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    if box_only:
        hard = replace(CONDITIONS[condition or "exact"], settings=CONDITIONS["renderer"].settings, has_initial=False)
        meshes = {chair.name: chair.mesh() for chair in chairs}
        scenes = [hard.scene(index, meshes, angles, clutter, seed=seed) for index in range(count)]
        own = {made.model: tuple(one for one in chairs if (one.name == made.model) != unknown_model) for made in scenes}
        return [replace(made, candidates=own[made.model]) for made in scenes]
    some = render_examples(
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
    parser.add_argument("--box-only", action="store_true", help="no initial pose, and the look of another renderer")


def objects_of(options: argparse.Namespace, condition: str = "") -> list[Example]:
    """The objects that the options of :func:`add_options` choose."""
    return objects(
        options.objects,
        options.models,
        options.viewpoints,
        unknown_model=options.unknown_model,
        seed=options.seed,
        condition=condition,
        box_only=options.box_only,
    )


def estimate(example: Example, choices: dict[str, Any]) -> PoseEstimate:
    models = {model.name: model.mesh() for model in example.candidates}
    return estimate_pose(example.image, models, box=example.box, **{"initial": example.initial, **choices})


def seconds_of(example: Example, choices: dict[str, Any]) -> float:
    """Processor seconds of the second of two searches; the first prepares the models."""
    estimate(example, choices)
    start = time.process_time()
    estimate(example, choices)
    return time.process_time() - start


def timed(examples: Iterable[Example], choices: dict[str, Any]) -> tuple[list[PoseEstimate], Summary]:
    """The results, and a summary of the seconds of the processor."""
    results, seconds = [], []
    for example in examples:
        start = time.process_time()
        results.append(estimate(example, choices))
        seconds.append(time.process_time() - start)
    return results, summary(seconds)


def spread(seconds: Summary) -> str:
    return f"{digits(seconds['median'])} ({digits(seconds['q1'])}…{digits(seconds['q3'])})"


def row(name: str, examples: list[Example], choices: dict[str, Any]) -> list[str]:
    """The table's row of a search on objects."""
    first = timed(examples, choices)[1]
    results, seconds = timed(examples, choices)
    pairs = [(result.azimuth, example.azimuth) for result, example in zip(results, examples, strict=True)]
    shares = [np.mean([bool(same_view(*pair, views)) for pair in pairs]) for views in VIEW_COUNTS]
    errors = [float(azimuth_error(*pair)) for pair in pairs]
    shares.append(np.mean([error <= WITHIN for error in errors]))
    renderings = np.median([result.renderings for result in results])
    figures = [f"{np.median(errors):.2f}°", f"{renderings:.0f}", spread(seconds), digits(first["median"])]
    return [name, *(f"{100 * share:.1f}" for share in shares), *figures]


def by_height(heights: list[int], count: int, seed: int) -> str:
    """Errors of the rotation by the height of known chairs in pixels."""
    models, angles = load_meshes(CHAIRS), sample_viewpoints(10_000, np.random.default_rng(seed))
    clutter, rows = [sample_photograph(name) for name in SAMPLE_NAMES], []
    for height in heights:
        side = max(224, int(1.8 * height))
        settings = SceneSettings(size=side, height=(0.95 * height, 1.05 * height), box_jitter=0, shadow=0.5)
        errors = []
        for index in range(count):
            made = scene(index, models, angles, clutter, seed=seed, settings=settings)
            result = estimate_pose(made.image, models[made.model], box=made.box)
            found = [(result.azimuth, result.elevation, result.theta)]
            errors.append(float(rotation_error(found, made.pose[[0, 1, 3]].tolist()).min()))
        right = np.mean([error <= WITHIN for error in errors])
        rows.append([str(height), f"{np.median(errors):.2f}°", f"{100 * right:.0f}"])
    return table(["pixels", "median rotation error", f"within {WITHIN:g}°, %"], rows)


def jittered(examples: list[Example], shares: list[float], seed: int) -> str:
    """How often five boxes that are a little off lead to one answer."""
    rows = []
    for share in shares:
        alike = right = 0
        for index, example in enumerate(examples):
            generator = np.random.default_rng([seed, index])
            assert example.box is not None
            azimuths = []
            for _ in range(BOXES):
                off = share * generator.uniform(-1, 1, 4) * np.tile([example.box.width, example.box.height], 2)
                box = np.array(example.box) + off
                height, width = example.image.shape[1:]
                inside = as_box("box", box.clip(0, [width, height, width, height]).tolist())
                azimuths.append(estimate(replace(example, box=inside, initial=None), {}).azimuth)
            apart = [float(azimuth_error(*pair)) for pair in combinations(azimuths, 2)]
            alike += max(apart) <= WITHIN
            right += all(float(azimuth_error(each, example.azimuth)) <= WITHIN for each in azimuths)
        rows.append([f"{100 * share:g} %", f"{alike} of {len(examples)}", str(right)])
    return table(["boxes off by up to", "one answer", "all right"], rows)


def growth(examples: list[Example], methods: list[str]) -> str:
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
    parser.add_argument("--heights", type=int, nargs="+", metavar="PIXELS", help="table by the objects' height instead")
    parser.add_argument("--jitter", type=float, nargs="+", metavar="SHARE", help="table by the error of boxes instead")
    options = parser.parse_args()
    options.unknown_model |= options.growth
    torch.set_num_threads(options.threads)
    print(f"{options.objects} objects, seed {options.seed}, {options.threads} threads\n")
    if options.growth:
        print(growth(objects_of(options), options.methods))
        return
    if options.heights:
        print(by_height(options.heights, options.objects, options.seed))
        return
    if options.jitter:
        print(jittered(objects_of(options, options.conditions[0]), options.jitter, options.seed))
        return
    rows = []
    for condition in options.conditions:
        examples = objects_of(options, condition)
        rows += [row(f"{condition} {method}".strip(), examples, {"method": method}) for method in options.methods]
    views = [f"{count} views" for count in VIEW_COUNTS]
    figures = ["median error", "renderings", "CPU s", "first pass"]
    print(table(["search", *views, f"within {WITHIN:g}°", *figures], rows))


if __name__ == "__main__":
    main()
