"""How fast each way to minimise Eq. 9 comes to a descriptor, to convergence.

    python benchmarks/published.py [--images DIR] [--every N] [--limit N] [--seconds S] [--chart FILE] [--json FILE]

All minimise the same objective of the paper's search (UoCTTI, gray values, ξ = 100), from the same noise, each image
alone in one thread: Powell's dogleg with Gauss-Newton steps solved to a millionth, as by default (1e-4, at most 200
iterations of conjugate gradients) and truncated (0.1, at most 10), and L-BFGS.  Prints the smallest distance
‖φ(x) - d‖ / ‖d‖ after so many seconds, its geometric mean over the images; a search that has ended keeps its last.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from charts import Curve, chart
from nablahog import HOGSpec, hog, presets
from nablahog.invert import AsPublished
from nablahog.invert.published_objective import PublishedObjective
from nablahog.invert.start import noise
from nablahog.optimize import Minimiser, minimise
from photographs import photographs

AXIS = (1, 2, 5, 10, 20, 40, 80, 160)  # seconds
FINER = 2  # points of the chart for each doubling of time
WAYS: dict[str, tuple[Minimiser, dict[str, Any]]] = {
    "dogleg, exact": ("dogleg", {"cg_tolerance": 1e-6, "cg_iterations": 2000}),
    "dogleg, 1e-4 or 200": ("dogleg", {"cg_tolerance": 1e-4, "cg_iterations": 200}),
    "dogleg, 0.1 or 10": ("dogleg", {"cg_tolerance": 0.1, "cg_iterations": 10}),
    "L-BFGS": ("lbfgs", {}),
}


Course = tuple[list[float], list[float]]  # seconds, and the smallest distance by then


class OutOfTime(Exception):
    """The seconds are over."""


def search(way: str, image: Tensor, spec: HOGSpec, seconds: float) -> Course:
    """Seconds and smallest distance after each evaluation, for one image (1, 1, H, W)."""
    minimiser, rules = WAYS[way]
    options, size = AsPublished().for_spec(spec), (image.shape[2], image.shape[3])
    descriptor = hog(image, spec)
    objective = PublishedObjective(descriptor, spec, size, options.course[0], options.norms)
    times: list[float] = []
    lowest: list[float] = []

    def watch(_: Tensor, __: Tensor) -> None:
        times.append(time.perf_counter() - began)
        lowest.append(min([float(objective.distance), *lowest[-1:]]))
        if times[-1] > seconds:
            raise OutOfTime

    start = noise(descriptor, *size, 1, 0, options.noise or 0)[:, 0].flatten(1)
    began = time.perf_counter()
    with contextlib.suppress(OutOfTime):
        minimise(minimiser, objective, start, max_evaluations=10**6, watch=watch, **rules)
    return times, lowest


def reached(courses: list[Course], axis: Iterable[float]) -> list[float]:
    """The smallest distance after so many seconds each, its geometric mean over the images."""
    each = [[lowest[max(1, sum(t <= at for t in times)) - 1] for at in axis] for times, lowest in courses]
    return [float(figure) for figure in np.exp(np.log(each).mean(axis=0))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of 128x128 images; by default those scikit-image installs")
    parser.add_argument("--every", type=int, default=1, help="only every Nth image")
    parser.add_argument("--limit", type=int, help="only the first N of these")
    parser.add_argument("--seconds", type=float, default=AXIS[-1], help="for each image and way")
    parser.add_argument("--chart", type=Path, help="write a picture of the courses to this file, too")
    parser.add_argument("--json", type=Path, help="write all times and distances to this file, too")
    options = parser.parse_args()
    torch.set_num_threads(1)
    images = photographs(options.images)[:: options.every][: options.limit]
    spec = presets.uoctti()
    for way in WAYS:
        search(way, images[:1], spec, 0.1)  # what runs first is slower
    axis = [at for at in AXIS if at <= options.seconds]
    print(f"{len(images)} images of {images.shape[2]}x{images.shape[3]}")
    print(f"| | {' | '.join(f'{at} s' for at in axis)} | ends after |\n|---|{'---:|' * (len(axis) + 1)}")
    courses: dict[str, list[Course]] = {}
    for way in WAYS:
        courses[way] = [search(way, image, spec, options.seconds) for image in images.split(1)]
        figures = " | ".join(f"{figure:.3f}" for figure in reached(courses[way], axis))
        print(f"| {way} | {figures} | {np.median([times[-1] for times, _ in courses[way]]):.0f} s |", flush=True)
    if options.chart:
        finer = [2 ** (k / FINER) for k in range(10 * FINER) if 2 ** (k / FINER) <= options.seconds]
        curves = [Curve(way, [*zip(finer, reached(courses[way], finer), strict=True)], k) for k, way in enumerate(WAYS)]
        chart(options.chart, "distance of the descriptors", "seconds", [(at, str(at)) for at in axis], curves)
    if options.json:
        options.json.write_text(json.dumps(courses))


if __name__ == "__main__":
    main()
