"""Is the confidence of a pose the share of poses that are right?  And which weights does it have?

    python benchmarks/confidence.py [--models DIR] [--viewpoints CSV] [--objects 60] [--seed 0] [--unknown-model]
        [--rows NAME,…] [--unrelated 60] [--fit]

Rows are conditions of `nablahog table2 --conditions all`.  Beside their objects there are boxes of photographs without
any object, whose poses are all wrong.
The table has the share of right poses by confidence; below are the Brier scores of the confidence and of a logistic
regression on the similarity alone, which is fitted to these objects.  With --fit the weights of
`nablahog.pose.confidence` are fitted to these objects, too, and printed.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import azimuth_error
from nablahog.paper.conditions import CONDITIONS
from nablahog.paper.models import Meshes, models_in, procedural_chairs
from nablahog.paper.viewpoints import read_viewpoints, sample_viewpoints
from nablahog.pose import PoseEstimate, confidence, estimate_pose
from nablahog.pose import estimate as estimate_module
from nablahog.pose.confidence import RIGHT, Evidence

SIDE = 100  # pixels of the shortest side of a box without the object
RIDGE = 0.01  # of the weights' squares
BINS = 5
ALL_KINDS = "as-table2,sides-10,photograph-cut-30,no-box-no-pose,tilted"
Floats = NDArray[np.float64]


def logistic(features: Floats, right: Floats) -> Floats:
    """Weights of a logistic regression, the constant first, by Newton's method."""
    columns = np.column_stack([np.ones(len(features)), features])
    weights = np.zeros(columns.shape[1])
    for _ in range(50):
        probability = 1 / (1 + np.exp(-columns @ weights))
        gradient = columns.T @ (probability - right) + RIDGE * weights
        curvature = columns.T @ (columns * (probability * (1 - probability))[:, None])
        weights -= np.linalg.solve(curvature + RIDGE * np.eye(len(weights)), gradient)
    return weights


def predicted(weights: Floats, features: Floats) -> Floats:
    result: Floats = 1 / (1 + np.exp(-(weights[0] + features @ weights[1:])))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default procedural chairs")
    parser.add_argument("--viewpoints", type=Path, help="CSV of azimuth and elevation; by default drawn at random")
    parser.add_argument("--objects", type=int, default=60, help="of each row")
    parser.add_argument("--unrelated", type=int, default=60, help="boxes without the object")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--unknown-model", action="store_true", help="leave an object's own model out")
    parser.add_argument("--rows", default=ALL_KINDS, help="conditions, separated by commas")
    parser.add_argument("--fit", action="store_true", help="print weights fitted to these objects")
    parser.add_argument("--save", type=Path, help="write similarity, rival, agreement, right to this file, CSV")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    models = procedural_chairs(24) if options.models is None else models_in(options.models)[0]
    rng = np.random.default_rng(options.seed)
    views = sample_viewpoints(10_000, rng) if options.viewpoints is None else read_viewpoints(options.viewpoints)
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    meshes = Meshes(models)
    seen: list[tuple[Evidence, float, bool]] = []
    evidence: list[Evidence] = []
    weigh = confidence.confidence

    def record(of: Evidence, *, known_model: bool) -> float:
        evidence.append(of)
        return weigh(of, known_model=known_model)

    vars(estimate_module)["confidence"] = record

    def add(true: float | None, *arguments: Any, **keywords: Any) -> None:
        result: PoseEstimate = estimate_pose(*arguments, **keywords)
        azimuths = (result.azimuth, *result.equivalent_azimuths)
        right = true is not None and min(float(azimuth_error(each, true)) for each in azimuths) <= RIGHT
        assert result.confidence is not None
        seen.append((evidence[-1], result.confidence, right))

    for name in options.rows.split(","):
        for index in range(options.objects):
            case, made = CONDITIONS[name].scene(index, meshes, views, clutter, seed=options.seed)
            some = {each: meshes[each] for each in meshes if (each == made.model) != options.unknown_model}
            add(float(made.pose[0]), case.image, some, box=case.box, initial=case.initial)
        print(f"{name}: {np.mean([one[2] for one in seen[-options.objects :]]):.1%} right", flush=True)
    for index in range(options.unrelated):
        generator = np.random.default_rng([options.seed, index, 2])
        image = clutter[index % len(clutter)]
        sides = image.shape[1:]
        size = [int(generator.integers(min(SIDE, side), side + 1)) for side in sides]
        top, left = (int(generator.integers(side - one + 1)) for side, one in zip(sides, size, strict=True))
        box = (left, top, left + size[1], top + size[0]) if index % 2 else None
        names = sorted(meshes)
        one = names[int(generator.integers(len(names)))]
        some = {each: meshes[each] for each in names if (each == one) != options.unknown_model}
        add(None, image, some, box=box)
    right = np.array([one[2] for one in seen], np.float64)
    sure = np.array([one[1] for one in seen])
    raw = np.array([one[0] for one in seen])
    features = raw.copy()
    features[:, 0] = np.log1p(raw[:, 0].clip(0))
    print(f"\n{len(seen)} poses, seed {options.seed}, {right.mean():.1%} right\n")
    print("| confidence | poses | mean | right |\n|---|---:|---:|---:|")
    for low in np.arange(BINS) / BINS:
        among = (sure >= low) & ((sure < low + 1 / BINS) | (low + 1 / BINS >= 1))
        if among.any():
            means = f"{sure[among].mean():.2f} | {right[among].mean():.2f}"
            print(f"| {low:.1f}…{low + 1 / BINS:.1f} | {among.sum()} | {means} |")
    plain = predicted(logistic(features[:, :1], right), features[:, :1])
    constant = right.mean() * (1 - right.mean())
    brier = np.mean((sure - right) ** 2), np.mean((plain - right) ** 2)
    scores = f"{brier[0]:.4f}; of the similarity alone {brier[1]:.4f}; of the share that is right {constant:.4f}"
    print(f"\nBrier score {scores}")
    if options.fit:
        weights = logistic(features, right)
        print("weights", weights.round(2), f"Brier score {np.mean((predicted(weights, features) - right) ** 2):.4f}")
    if options.save is not None:
        np.savetxt(options.save, np.column_stack([raw, right]), delimiter=",")


if __name__ == "__main__":
    main()
