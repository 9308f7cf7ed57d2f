"""How much each choice that the paper leaves open moves its Table 1, and how much each step of ours does.

    python benchmarks/choices.py [--images DIR] [--every N] [--limit N] [--only paper|ours] [--of uoctti|paper]
        [--json FILE]

The first tables search as the paper does, ``reconstruct(…, method="paper")``; each row changes one choice of the first,
the base.  The last tables take one step away from ``nablahog.reconstruct`` or change it.  Prints means over the images;
figures as `nablahog.metrics.DEFINITIONS` defines them.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from nablahog import HOGSpec, hog, metrics, presets, reconstruct
from nablahog.invert import AsPublished
from nablahog.invert.multiscale import reconstruct_multiscale, scale_descriptors
from nablahog.invert.options import Objective, Search
from nablahog.invert.published_objective import PublishedObjective
from nablahog.invert.reconstruction import to_unit_range
from nablahog.invert.start import noise
from nablahog.optimize import lbfgs
from photographs import photographs

Variant = tuple[str, Callable[[Tensor], Tensor], HOGSpec]


def size_of(images: Tensor) -> tuple[int, int]:
    return images.shape[2], images.shape[3]


def published(spec: HOGSpec, seed: int = 0, **choices: Any) -> Callable[[Tensor], Tensor]:
    """Images (B, 1, H, W) in 0…1 to their pre-images by the paper's search."""
    method = AsPublished(**choices)
    return lambda images: reconstruct(hog(images, spec), spec, size_of(images), method=method, seed=seed).image


def by_lbfgs(spec: HOGSpec, evaluations: int) -> Callable[[Tensor], Tensor]:
    """The same objective from the same noise, minimised by L-BFGS."""
    options = AsPublished().for_spec(spec)
    spread = options.noise
    assert spread is not None

    def search(images: Tensor) -> Tensor:
        descriptor, size = hog(images, spec), size_of(images)
        objective = PublishedObjective(descriptor, spec, size, options.course[0], options.norms)
        start = noise(descriptor, *size, 1, 0, spread)[0].flatten(1).expand(len(images), -1)
        return to_unit_range(objective.images(lbfgs(objective, start, max_evaluations=evaluations).x), spec)

    return search


def published_levels(
    spec: HOGSpec, more: bool, upsampling: str | None = None, same_votes: bool = True, **choices: Any
) -> Callable[[Tensor], Tensor]:
    """The same with four levels.

    Args:
        spec: of the last.
        more: whether each level is given the descriptor of the image at its size.
        upsampling: of images from level to level, a mode of `torch.nn.functional.interpolate`.
        same_votes: whether the one descriptor of all levels is made that of an image of their size.
        choices: of `AsPublished`.
    """

    def enlarge(image: Tensor, height: int, width: int) -> Tensor:
        return interpolate(image, (height, width), mode=upsampling or "bicubic")

    def search(images: Tensor) -> Tensor:
        descriptors = (
            scale_descriptors(images, spec) if more else hog(images, spec) if same_votes else [hog(images, spec)] * 4
        )
        with patch("nablahog.invert.multiscale.enlarge", enlarge):
            levels = reconstruct_multiscale(descriptors, spec, size_of(images), method=AsPublished(**choices))
        return levels[-1].reconstruction.image

    return search


def figures(result: Tensor, images: Tensor, spec: HOGSpec) -> dict[str, float]:
    """Means over the images."""
    pairs = [(f, i) for f, i in zip(result[:, 0], images[:, 0], strict=True)]
    cc = [metrics.cross_correlation(*pair) for pair in pairs]
    target = hog(images, spec)
    distance = (hog(result, spec) - target).flatten(1).norm(dim=1) / target.flatten(1).norm(dim=1)
    return {
        "CC": float(np.mean(cc)),
        "|CC|": float(np.mean(np.abs(cc))),
        "MI": float(np.mean([metrics.mutual_information(*pair) for pair in pairs])),
        "SSIM": float(np.mean([metrics.ssim(*pair) for pair in pairs])),
        "distance": float(distance.nanmean()),
    }


def paper_variants(of: str) -> list[Variant]:
    """The paper's search, and what changes it, for the descriptor type ``of``."""
    preset = getattr(presets, of)
    spec: HOGSpec = preset()
    rows: list[Variant] = [("base", published(spec), spec)]

    def add(name: str, changed: HOGSpec | None = None, **choices: Any) -> None:
        rows.append((name, published(changed or spec, **choices), changed or spec))

    add("another seed", seed=1)
    weights = (0.01, 0.1, 1.0, 10.0, 100.0) if of == "paper" else (1.0, 10.0, 1000.0)
    for weight in weights:
        add(f"ξ = {weight:g}", smoothness=weight)
    falling = [3.0, 0.3, 0.03] if of == "paper" else [1000.0, 100.0, 10.0]
    add(f"ξ falls: {', '.join(f'{weight:g}' for weight in falling)}", smoothness=falling)
    for weight in (0.001, 0.01, 0.1, 1.0) if of == "paper" else (0.1, 1.0, 10.0, 100.0):
        add(f"norms as printed, ξ = {weight:g}", norms="printed", smoothness=weight)
    if of == "uoctti":
        add("norms as printed, ξ = 100, noise of 0.01", norms="printed", noise=0.01)
    for deviation in (1e-3, 1e-1) if of == "paper" else (1e-2,):
        add(f"start: noise of {deviation:g}", noise=deviation)
    add("8 neighbours", neighbours=8)
    for n in (10, 20, 80):
        add(f"{n} iterations", iterations=n)
    for n in (10, 40):
        add(f"a step's equations: {n} iterations of conjugate gradients", cg_iterations=n)
    add("a step's equations: to 1e-6, or 1000 iterations", cg_tolerance=1e-6, cg_iterations=1000)
    rows.append(("minimiser: L-BFGS, 3000 evaluations", by_lbfgs(spec, 3000), spec))
    if of == "paper":
        add("normaliser √(‖v‖² + ε²), ξ = 100, noise of 1e-4", preset(global_form="robust"))
        for epsilon in (1e-3, 1e-1):
            add(f"ε = {epsilon:g}", preset(epsilon=epsilon))
        add("bins centred at 0°, 20°, …", preset(bin_offset=0.0))
        add("border repeated", preset(border="replicate"))
    else:
        add("hard votes", preset(vote="hard"))
    for cell in (4, 16):
        add(f"cells of {cell}", preset(cell))
    for more in (False, True):
        name = "multi-scale-more" if more else "multi-scale"
        levels: list[tuple[str, dict[str, Any]]] = [("", {})]
        if of == "paper":
            levels += [(f", {mode}", {"upsampling": mode}) for mode in ("nearest", "bilinear")]
            levels += [(f", {n} iterations a level", {"level_iterations": n}) for n in (3, 40)]
            if not more:
                levels.append((", the descriptor unchanged", {"same_votes": False}))
        rows += [(f"{name}{what}", published_levels(spec, more, **options), spec) for what, options in levels]
    return rows


def our_variants(of: str) -> list[Variant]:
    """``reconstruct`` and what is left without one of its steps."""
    spec = getattr(presets, of)()

    def run(**options: Any) -> Callable[[Tensor], Tensor]:
        return lambda images: reconstruct(hog(images, spec), spec, size_of(images), **options).image

    def run_levels(more: bool, **options: Any) -> Callable[[Tensor], Tensor]:
        def levels(images: Tensor) -> Tensor:
            given = scale_descriptors(images, spec) if more else hog(images, spec)
            return reconstruct_multiscale(given, spec, size_of(images), **options)[-1].reconstruction.image

        return levels

    rows = [("reconstruct", run())]
    if spec.signed:
        rows += [
            ("one sample, nothing expected", run(search=Search(samples=1))),
            ("3 samples", run(search=Search(samples=3))),
            ("6 samples, 480 evaluations", run(search=Search(samples=6, max_evaluations=480))),
            ("12 samples, 1500 evaluations", run(search=Search(samples=12, max_evaluations=1500))),
            ("λ = 0, from the samples' mean", run(objective=Objective(closeness=0.0))),
            ("λ = 0.1", run(objective=Objective(closeness=0.1))),
            ("λ = 0.3", run(objective=Objective(closeness=0.3))),
            ("λ = 3", run(objective=Objective(closeness=3.0))),
        ]
    else:
        rows += [
            ("no polarity", run(search=Search(polarity=False))),
            ("no region signs", run(search=Search(region_signs=False))),
            ("neither", run(search=Search(region_signs=False, polarity=False))),
            ("λ = 0, from the region signs", run(objective=Objective(closeness=0.0))),
            ("λ = 1", run(objective=Objective(closeness=1.0))),
            ("960 evaluations", run(search=Search(max_evaluations=960))),
        ]
    rows += [
        ("no smoothness", run(objective=Objective(smoothness=0.0))),
        ("smoothness 0.1", run(objective=Objective(smoothness=0.1))),
        ("pixels as unknowns", run(search=Search(basis="pixels"))),
        ("240 evaluations", run(search=Search(max_evaluations=240))),
        ("multi-scale", run_levels(False)),
        ("multi-scale-more", run_levels(True)),
    ]
    return [(name, of_row, spec) for name, of_row in rows]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of 128x128 images; by default those scikit-image installs")
    parser.add_argument("--every", type=int, default=1, help="only every Nth image")
    parser.add_argument("--limit", type=int, help="only the first N of these")
    parser.add_argument("--only", choices=("paper", "ours"), help="only these tables")
    parser.add_argument("--of", choices=("uoctti", "paper"), help="only the tables of this descriptor")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures to this file, too")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    images = photographs(options.images)[:: options.every][: options.limit]

    tables = {"as published": paper_variants, "nablahog.reconstruct": our_variants}
    if options.only:
        tables.pop("nablahog.reconstruct" if options.only == "paper" else "as published")
    stored = {}
    for title, variants in tables.items():
        for of in (options.of,) if options.of else ("uoctti", "paper"):
            print(f"\n{title}, {of}, {len(images)} images of {images.shape[2]}x{images.shape[3]}")
            print(
                "| | CC | |CC| | MI | SSIM | distance | s an image |\n|---|---:|---:|---:|---:|---:|---:|".replace(
                    "|CC|", "\\|CC\\|"
                )
            )
            for name, run, spec in variants(of):
                began = time.perf_counter()
                result = run(images)
                seconds = (time.perf_counter() - began) / len(images)
                row = {**figures(result, images, spec), "seconds": seconds}
                stored[f"{title}, {of}: {name}"] = row
                print(f"| {name} | {' | '.join(f'{value:.3f}' for value in row.values())} |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(stored, indent=1))


if __name__ == "__main__":
    main()
