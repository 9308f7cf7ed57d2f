"""How often is the pose right where the box is rough, cut off or missing, and where the camera is tilted?

    python benchmarks/rough_boxes.py [--models DIR] [--viewpoints CSV] [--objects 200] [--seed 0] [--threads 1]
        [--timed 40] [--rows 'NAME;…'] [--json FILE] [--failures DIR]

The objects are those of `nablahog table2` with the same options, of which each row changes the box, the photograph or
the viewpoint; the model is the object's own.  Times are those of `nablahog.estimate_pose` alone, for models that have
been prepared.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from torch import Tensor

from nablahog.datasets.scenes import Scene, SceneSettings, scene
from nablahog.datasets.viewpoints import read_viewpoints, sample_viewpoints
from nablahog.evaluate.models import Meshes, models_in, procedural_chairs
from nablahog.hog.box import Box
from nablahog.io.images import write_image
from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import azimuth_error
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.render import silhouette
from nablahog.viz.pictures import outlined
from nablahog.viz.similarity_plot import boxed

Generator = np.random.Generator
WITHIN = 15.0  # degrees of azimuth, that count as right
EXACT = SceneSettings(box_jitter=0)
WIDE = replace(EXACT, size=640, height=(100.0, 300.0))
LANDSCAPE = 480  # rows of a photograph that is 640 pixels wide


@dataclass(frozen=True, eq=False)
class Case:
    """What a search is given of an object.

    Attributes:
        image: (3, H, W).
        box: of the object; None if unknown.
        initial: azimuth and elevation, degrees; None if unknown.
    """

    image: Tensor
    box: Box | None
    initial: tuple[float, float] | None


def off(share: float) -> Callable[[Case, Generator], Case]:
    """Each side is that share of the box's width or height off, inwards or outwards."""

    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        signs = share * generator.choice([-1, 1], 4)
        return replace(case, box=Box.of(np.array(case.box) + signs * np.tile([case.box.width, case.box.height], 2)))

    return change


def larger(share: float) -> Callable[[Case, Generator], Case]:
    """The box is that share wider and higher."""

    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        more = share / 2 * np.array([-1, -1, 1, 1])
        return replace(case, box=Box.of(np.array(case.box) + more * np.tile([case.box.width, case.box.height], 2)))

    return change


def cut(share: float, *, photograph: bool) -> Callable[[Case, Generator], Case]:
    """One side of the box is moved inwards by a share of its width or height, perhaps with the photograph's border."""

    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        side = int(generator.integers(4))
        sides = np.array(case.box)
        sides[side] += share * np.tile([case.box.width, case.box.height], 2)[side] * (1 if side < 2 else -1)
        box = Box.of(sides)
        if not photograph:
            return replace(case, box=box)
        height, width = case.image.shape[1:]
        border = [0, 0, width, height]
        border[side] = round(sides[side])
        image = case.image[:, border[1] : border[3], border[0] : border[2]]
        return replace(case, image=image, box=Box.of(np.array(box) - np.tile(border[:2], 2)))

    return change


def no_box(case: Case, generator: Generator) -> Case:
    return replace(case, box=None)


def unchanged(case: Case, generator: Generator) -> Case:
    return case


def landscape(case: Case, generator: Generator) -> Case:
    """640x480 pixels of a square photograph, with all of the object, and no box."""
    assert case.box is not None
    low, high = max(0, int(case.box.y1) + 1 - LANDSCAPE), min(int(case.box.y0), case.image.shape[1] - LANDSCAPE)
    top = int(generator.integers(low, high + 1))
    return replace(case, image=case.image[:, top : top + LANDSCAPE], box=None)


def tilted(viewpoint: np.ndarray[Any, Any], generator: Generator) -> None:
    """In-plane rotations of 12 to 45 degrees."""
    viewpoint[2] = generator.choice([-1, 1]) * generator.uniform(12, 45)


def steep(viewpoint: np.ndarray[Any, Any], generator: Generator) -> None:
    """Elevations of -20 to 75 degrees: higher up, azimuth and in-plane rotation are one."""
    viewpoint[1] = generator.uniform(-20, 75)


@dataclass(frozen=True)
class Row:
    """A kind of object.

    Attributes:
        change: of what the search is given.
        viewpoint: of the viewpoint, azimuth, elevation, theta.
        given: whether it is given an initial pose, as in the table.
        settings: of the scenes.
    """

    change: Callable[[Case, Generator], Case] = unchanged
    viewpoint: Callable[[np.ndarray[Any, Any], Generator], None] | None = None
    given: bool = True
    settings: SceneSettings = EXACT


ROWS: Mapping[str, Row] = {
    "as table2": Row(settings=SceneSettings()),
    "exact box": Row(),
    "exact box, nothing given": Row(given=False),
    "sides 5 % off": Row(off(0.05)),
    "sides 10 % off": Row(off(0.1)),
    "20 % larger": Row(larger(0.2)),
    "40 % larger": Row(larger(0.4)),
    "box cut by 15 %": Row(cut(0.15, photograph=False)),
    "box cut by 30 %": Row(cut(0.3, photograph=False)),
    "photograph cut by 15 %": Row(cut(0.15, photograph=True)),
    "photograph cut by 30 %": Row(cut(0.3, photograph=True)),
    "no box": Row(no_box),
    "no box, nothing given": Row(no_box, given=False),
    "no box, 640x480": Row(landscape, settings=WIDE),
    "no box, 640x480, nothing given": Row(landscape, given=False, settings=WIDE),
    "tilted 12-45": Row(viewpoint=tilted, given=False),
    "elevation -20-75": Row(viewpoint=steep, given=False),
    "sides 10 % off, tilted": Row(off(0.1), tilted, given=False),
}


def case_of(
    row: Row, index: int, meshes: Meshes, views: np.ndarray[Any, Any], clutter: list[Tensor], seed: int
) -> tuple[Case, Scene]:
    """One object of a row: what a search is given, and the truth."""
    generator = np.random.default_rng([seed, index, 1])
    viewpoints = views
    if row.viewpoint is not None:
        viewpoint = views[generator.integers(len(views))].copy()
        row.viewpoint(viewpoint, generator)
        viewpoints = viewpoint[None]
    made = scene(index, meshes, viewpoints, clutter, seed=seed, settings=row.settings)
    initial = (float(made.initial[0]), float(made.initial[1])) if row.given else None
    return row.change(Case(made.image, made.box, initial), generator), made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default procedural chairs")
    parser.add_argument("--viewpoints", type=Path, help="CSV of azimuth and elevation; by default drawn at random")
    parser.add_argument("--objects", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--timed", type=int, default=40, help="the first so many objects, that are searched twice")
    parser.add_argument("--rows", help="only these, separated by semicolons")
    parser.add_argument("--json", type=Path, help="write each object's figures to this file, too")
    parser.add_argument("--failures", type=Path, help="write a picture of each wrong pose to this folder")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    models = procedural_chairs(24) if options.models is None else models_in(options.models)[0]
    rng = np.random.default_rng(options.seed)
    views = sample_viewpoints(10_000, rng) if options.viewpoints is None else read_viewpoints(options.viewpoints)
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    meshes = Meshes(models)
    rows = ROWS if options.rows is None else {name: ROWS[name] for name in options.rows.split(";")}
    print(f"{options.objects} objects, seed {options.seed}, {options.threads} threads\n")
    print(
        "| box | within 15° | median error | s, median (max) | CPU s, median | first |\n|---|---:|---:|---:|---:|---:|"
    )
    kept: dict[str, list[dict[str, Any]]] = {}
    for name, row in rows.items():
        results = kept.setdefault(name, [])
        for index in range(options.objects):
            case, made = case_of(row, index, meshes, views, clutter, options.seed)
            clocks = []
            for _ in range(2 if index < options.timed else 1):  # the first prepares the model
                start = time.perf_counter(), time.process_time()
                result = estimate_pose(case.image, meshes[made.model], box=case.box, initial=case.initial)
                clocks.append((time.perf_counter() - start[0], time.process_time() - start[1]))
            error = float(azimuth_error(result.azimuth, float(made.pose[0])))
            results.append(
                {
                    "index": index,
                    "model": made.model,
                    "true": made.pose[[0, 1, 3]].tolist(),
                    "azimuth": result.azimuth,
                    "elevation": result.elevation,
                    "theta": result.theta,
                    "similarity": result.similarity,
                    "confidence": result.confidence,
                    "error": error,
                    "seconds": clocks[-1][0],
                    "cpu": clocks[-1][1],
                    "first": clocks[0][1],
                }
            )
            if options.failures is not None and error > WITHIN:
                draw(options.failures / f"{name}-{index:03d}-{made.model}.png", case, result, meshes[made.model])
        errors = [one["error"] for one in results]
        of = {key: [one[key] for one in results[: options.timed]] for key in ("seconds", "cpu", "first")}
        share = 100 * sum(error <= WITHIN for error in errors) / len(results)
        print(
            f"| {name} | {share:.1f} | {median(errors):.2f}° | {median(of['seconds']):.3f} "
            f"({max(of['seconds']):.3f}) | {median(of['cpu']):.3f} | {median(of['first']):.3f} |",
            flush=True,
        )
        if options.json is not None:
            options.json.write_text(json.dumps(kept))


def draw(path: Path, case: Case, result: PoseEstimate, mesh: Any) -> None:
    """Writes the photograph with the box and the outline of the model at the pose."""
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = outlined(case.image, silhouette(mesh, result.pose, result.camera)[0, 0].numpy() >= 0.5)
    write_image(path, picture if case.box is None else boxed(picture, [list(case.box)]))


if __name__ == "__main__":
    main()
