"""How often is the pose right where the box is rough, cut off or missing, and where the camera is tilted?

    python benchmarks/rough_boxes.py [--models DIR] [--viewpoints CSV] [--objects 200] [--seed 0] [--threads 1]
        [--timed 40] [--rows NAME,…] [--json FILE] [--failures DIR]

Rows are the conditions of `nablahog table2 --conditions all`, and objects those of the same options; the model is the
object's own.  Times are those of `nablahog.estimate_pose` alone, for models that have
been prepared.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from nablahog.io.images import write_image
from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import azimuth_error
from nablahog.paper.conditions import CONDITIONS, Case
from nablahog.paper.models import Meshes, models_in, procedural_chairs
from nablahog.paper.viewpoints import read_viewpoints, sample_viewpoints
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.render import silhouette
from nablahog.viz.pictures import outlined
from nablahog.viz.similarity_plot import boxed

WITHIN = 15.0  # degrees of azimuth, that count as right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default procedural chairs")
    parser.add_argument("--viewpoints", type=Path, help="CSV of azimuth and elevation; by default drawn at random")
    parser.add_argument("--objects", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--timed", type=int, default=40, help="the first so many objects, that are searched twice")
    parser.add_argument("--rows", help="only these, separated by commas")
    parser.add_argument("--json", type=Path, help="write each object's figures to this file, too")
    parser.add_argument("--failures", type=Path, help="write a picture of each wrong pose to this folder")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    models = procedural_chairs(24) if options.models is None else models_in(options.models)[0]
    rng = np.random.default_rng(options.seed)
    views = sample_viewpoints(10_000, rng) if options.viewpoints is None else read_viewpoints(options.viewpoints)
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    meshes = Meshes(models)
    rows = CONDITIONS if options.rows is None else {name: CONDITIONS[name] for name in options.rows.split(",")}
    print(f"{options.objects} objects, seed {options.seed}, {options.threads} threads\n")
    print("| condition | within 15° | median error | s, median (max) | CPU s, median | first |")
    print("|---|---:|---:|---:|---:|---:|")
    kept: dict[str, list[dict[str, Any]]] = {}
    for name, row in rows.items():
        results = kept.setdefault(name, [])
        for index in range(options.objects):
            case, made = row.scene(index, meshes, views, clutter, seed=options.seed)
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
