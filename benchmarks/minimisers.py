"""How close each minimiser comes to a descriptor, at equal numbers of operator evaluations and at equal time.

    python benchmarks/minimisers.py [--images DIR] [--limit N] [--threads N] [--json FILE]

All minimise the same objective, the descriptor's relative distance with the default prior, in the same unknowns and
from the same start, 128x128 pixels in cells of 8.  One evaluation is a value with its gradient; residuals alone, and a
product of their Jacobian or its transpose with a vector, are half of one.  Each image is searched alone, so that its
time is its own; equal time is what L-BFGS takes for so many evaluations of that image.  Prints the smallest distance
‖φ(x) - d‖ / ‖d‖ so far, its geometric mean over the images.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from nablahog import HOGSpec, hog, presets
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.prior.terms import RelativeSmoothness
from nablahog.invert.search import BASIS_EXPONENT, PreimageObjective
from nablahog.invert.starts import starting_images
from nablahog.invert.unknowns import CosineBasis, FlatRegions
from nablahog.optimize import MINIMISERS, Minimiser
from preimages import photographs

SIDE, CELL = 128, 8
EVALUATIONS = (50, 100, 200, 400)
MOST = 600  # so that no method that is faster than L-BFGS is cut short at equal time
NAMES: tuple[Minimiser, ...] = ("lbfgs", "dogleg")  # L-BFGS first: its times are the others' limits


def search(
    name: Minimiser, image: Tensor, spec: HOGSpec, most: int = MOST
) -> tuple[list[int], list[float], list[float]]:
    """Evaluations, seconds and smallest distance after each call of the objective, for one image (1, 1, H, W)."""
    descriptor = hog(image, spec)
    votes = recover_histograms(descriptor, spec)
    basis = CosineBasis(SIDE, SIDE, descriptor, BASIS_EXPONENT)
    flat = FlatRegions(descriptor, spec, SIDE, SIDE)
    evaluations: list[int] = []
    seconds: list[float] = []
    lowest: list[float] = []

    objective = PreimageObjective(descriptor, None, spec, basis, flat, (RelativeSmoothness(0.02),))

    def watch(_: Tensor, spent: Tensor) -> None:
        evaluations.append(int(spent))
        seconds.append(time.perf_counter() - began)
        lowest.append(min([float(objective.distance), *lowest[-1:]]))

    start = basis.unknowns(starting_images(votes, spec, SIDE, SIDE, 1, seed=0)[:, 0])
    began = time.perf_counter()
    MINIMISERS[name](objective, start, max_evaluations=most, watch=watch)
    return evaluations, seconds, lowest


def reached(axis: list[int] | list[float], lowest: list[float], limit: float) -> float:
    """The smallest distance when no more than ``limit`` evaluations or seconds were spent."""
    return lowest[max(sum(spent <= limit for spent in axis), 1) - 1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of 128x128 images; by default those scikit-image installs")
    parser.add_argument("--limit", type=int, help="only the first N images")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures of each image to this file, too")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    images = photographs(options.images)[: options.limit]

    rows: list[dict[str, Any]] = []
    for spec in (presets.paper(CELL), presets.uoctti(CELL)):
        for name in NAMES:
            search(name, images[:1], spec, most=20)  # what runs first is slower
        for i, image in enumerate(images.split(1)):
            limits: list[float] = []
            for name in NAMES:
                evaluations, seconds, lowest = search(name, image, spec)
                if name == "lbfgs":
                    limits = [seconds[sum(spent <= n for spent in evaluations) - 1] for n in EVALUATIONS]
                rows.append(
                    {
                        "descriptor": spec.name,
                        "image": i,
                        "minimiser": name,
                        "by evaluations": [reached(evaluations, lowest, n) for n in EVALUATIONS],
                        "by time": [reached(seconds, lowest, limit) for limit in limits],
                        "limits": limits,
                        "milliseconds": 1e3 * seconds[-1] / evaluations[-1],
                    }
                )

    print(f"{len(images)} images of {SIDE}x{SIDE}, cells of {CELL}, {options.threads} threads")
    for descriptor in ("paper", "uoctti"):
        of = [row for row in rows if row["descriptor"] == descriptor]
        limits = np.mean([row["limits"] for row in of], axis=0)
        columns = [f"{n} evaluations" for n in EVALUATIONS] + [f"{limit:.2f} s" for limit in limits]
        print(f"\n| {descriptor} | {' | '.join(columns)} | ms an evaluation |\n|---|{'---:|' * (len(columns) + 1)}")
        for name in NAMES:
            mine = [row for row in of if row["minimiser"] == name]
            logs = np.log([row["by evaluations"] + row["by time"] for row in mine])
            figures = [f"{figure:.4f}" for figure in np.exp(logs.mean(axis=0))]
            pace = np.mean([row["milliseconds"] for row in mine])
            print(f"| {name} | {' | '.join(figures)} | {pace:.1f} |")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
