"""How much each choice that the paper leaves open moves its Table 1, and how much each step of ours does.

    python benchmarks/choices.py [--images DIR] [--every N] [--limit N] [--only paper|ours] [--json FILE]

The first tables search as the paper does, with everything that it does not state at one assumption, the base: the
descriptor's relative distance over gray values from nearly constant images, with absolute differences of 4-neighbours
(Eq. 9), by L-BFGS.  Each row changes one assumption.  The last tables take one step away from ``nablahog.reconstruct``
or change it.  Prints means over the images; figures as `nablahog.metrics.DEFINITIONS` defines them.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from nablahog import HOGSpec, hog, metrics, presets, reconstruct
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.multiscale import SCALES, level_spec, reconstruct_multiscale, scale_descriptors
from nablahog.invert.options import Basis, Objective, Search
from nablahog.invert.priors import Prior, Range, RelativeSmoothness, Smoothness, TotalVariation
from nablahog.invert.reconstruction import to_unit_range
from nablahog.invert.search import PreimageSearch
from nablahog.invert.start import at_contrast
from nablahog.optimize import Minimiser
from photographs import photographs

Upsampling = Literal["nearest", "bilinear", "bicubic"]
WEIGHT = 1e-4  # of Σ|i_p - i_q|, on the scale of the relative squared distance


@dataclass(frozen=True)
class Assumptions:
    """One way to read Section 3.1."""

    priors: tuple[Prior, ...] = (Smoothness(WEIGHT),)
    basis: Basis = "pixels"
    minimiser: Minimiser = "lbfgs"
    evaluations: int = 150
    noise: float = 0.01  # standard deviation around mid-gray of the start, in 0…1
    seed: int = 0
    upsampling: Upsampling = "bilinear"
    per_level: int = 40


def as_published(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], a: Assumptions, start: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1 from (B, 1, H, W), the one objective from the one start."""
    search = PreimageSearch(descriptor, spec, size, a.priors, Search(a.minimiser, a.basis), a.evaluations)
    start = at_contrast(start, recover_histograms(descriptor, spec), spec)
    return to_unit_range(search.match(start.unsqueeze(1), None, a.evaluations)[:, 0], spec)


def noise(count: int, size: tuple[int, int], a: Assumptions) -> Tensor:
    generator = torch.Generator().manual_seed(a.seed)
    return (0.5 + a.noise * torch.randn(1, 1, *size, generator=generator)).expand(count, -1, -1, -1)


def single(images: Tensor, spec: HOGSpec, a: Assumptions) -> Tensor:
    size = (images.shape[2], images.shape[3])
    return as_published(hog(images, spec), spec, size, a, noise(len(images), size, a))


def multi_scale(images: Tensor, spec: HOGSpec, a: Assumptions, more: bool) -> Tensor:
    size = (images.shape[2], images.shape[3])
    descriptors = scale_descriptors(images, spec) if more else [hog(images, spec)] * len(SCALES)
    result = None
    for scale, descriptor in zip(SCALES, descriptors, strict=True):
        small, small_size = level_spec(spec, scale, size)
        mode = {} if a.upsampling == "nearest" else {"align_corners": False}
        start = (
            noise(len(images), small_size, a)
            if result is None
            else interpolate(result, size=small_size, mode=a.upsampling, **mode)
        )
        level = a if scale == 1 else replace(a, evaluations=a.per_level)
        result = as_published(descriptor, small, small_size, level, start)
    assert result is not None
    return result


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


Variant = tuple[str, Callable[[Tensor], Tensor], HOGSpec]


def paper_variants(of: str) -> list[Variant]:
    """The base and what changes it, for the descriptor type ``of``."""
    preset = getattr(presets, of)
    spec, base = preset(), Assumptions()
    rows: list[Variant] = []

    def add(name: str, changed: HOGSpec | None = None, **assumptions: Any) -> None:
        of_row = changed or spec
        rows.append((name, lambda images: single(images, of_row, replace(base, **assumptions)), of_row))

    add("base")
    add("another seed", seed=1)
    add("start: noise of 0.1", noise=0.1)
    for n in (50, 300):
        add(f"{n} evaluations", evaluations=n)
    for name in ("dogleg", "momentum", "adam"):
        add(f"minimiser: {name}", minimiser=name)
    add("unknowns: cosine basis", basis="cosine")
    add("no smoothness", priors=())
    for factor in (0.01, 0.1, 10.0):
        add(f"smoothness: absolute, ξ x {factor:g}", priors=(Smoothness(factor * WEIGHT),))
    for factor in (0.1, 1.0, 10.0):
        add(f"smoothness: squared, ξ x {factor:g}", priors=(Smoothness(factor * WEIGHT, "squared"),))
    add("smoothness: absolute, 8 neighbours", priors=(Smoothness(WEIGHT, neighbours=8),))
    add("smoothness: relative to the gradient, 0.02 (ours)", priors=(RelativeSmoothness(0.02),))
    add("smoothness: TV, β = 2", priors=(TotalVariation(WEIGHT),))
    if of == "paper":
        add("gray values kept in 0…1 (ours)", priors=(Smoothness(WEIGHT), Range(100.0)))
        add("normaliser √(‖v‖² + ε²)", preset(global_form="robust"))
        for epsilon in (1e-3, 1e-1):
            add(f"ε = {epsilon:g}", preset(epsilon=epsilon))
        add("bins centred at 0°, 20°, …", preset(bin_offset=0.0))
        add("border repeated", preset(border="replicate"))
    else:
        add("hard votes", preset(vote="hard"))
    for cell in (4, 16):
        add(f"cells of {cell}", preset(cell))
    for mode in ("bilinear", "nearest", "bicubic"):
        for more in (False, True):
            name = f"multi-scale{'-more' if more else ''}, {mode}"
            rows.append((name, _multi_scale(spec, replace(base, upsampling=mode), more), spec))
    rows += [
        (f"multi-scale-more, {n} a level", _multi_scale(spec, replace(base, per_level=n), True), spec)
        for n in (10, 100)
    ]
    return rows


def _multi_scale(spec: HOGSpec, a: Assumptions, more: bool) -> Callable[[Tensor], Tensor]:
    return lambda images: multi_scale(images, spec, a, more)


def size_of(images: Tensor) -> tuple[int, int]:
    return images.shape[2], images.shape[3]


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
        for of in ("uoctti", "paper"):
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
