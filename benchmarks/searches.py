"""Pre-images and poses beside what others do for them: quality, times, and what these are spent on.

Pre-images: the schedule of CNN-HOG, and the paper's search (``method="paper"``), of the same images.  Poses: 360
renderings, one a degree, and the paper's search, of the same scenes.  One thread, CPU time, in turns.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

import torch
from torch import Tensor

from growth import seconds_of
from limits import Rates, limits_ms, rendering_work, work
from nablahog import hog, metrics, presets, reconstruct
from nablahog.invert import AsPublished, Reconstruction, Search
from nablahog.invert.quality import QualityName
from nablahog.metrics import azimuth_error
from nablahog.paper.baselines.cnn_hog import CNNHOG
from nablahog.pose.prepared import pose_spec
from parts import of_search
from photographs import photographs
from poses import estimate, objects
from timing import Times, ratio, summary

SPEC = presets.uoctti()
OURS: tuple[QualityName, ...] = ("fast", "best")
CANVAS = 128  # pixels of a side of what poses are rendered to
RADIUS = 15.0  # degrees of azimuth within which a pose counts as right


def preimages(folder: Path | None, few: int, side: int | None, rates: Rates) -> dict[str, Any]:
    """Of a few images in turns, by each method; then of all images at once, by ours.

    Args:
        folder: of images of one size; by default those that scikit-image installs.
        few: images in turns.
        side: pixels that are left of each, if not all.
        rates: of the machine.
    """
    images = photographs(folder)[:, :, :side, :side]
    some = images[:: max(1, len(images) // few)][:few]
    methods = _methods()
    result: dict[str, list[Tensor]] = {name: [] for name in methods}
    times = {name: Times() for name in methods}
    reconstruct(hog(some[:1], SPEC), SPEC, search=Search(max_evaluations=3))
    _published(some[:1], AsPublished(iterations=1, cg_iterations=2))
    for quality in OURS:
        methods[quality](some[:1])
    for image in some:
        for name, method in methods.items():
            times[name].add(partial(_keep, result[name], method, image[None]))
    peers = [name for name in methods if name not in OURS]
    rows = {}
    for name in methods:
        ratios = {peer: ratio(times[peer].cpu, times[name].cpu) for peer in peers if name in OURS}
        rows[name] = {**times[name].summaries(), "cc": _correlation(torch.cat(result[name]), some), "ratios": ratios}
    size = (int(some.shape[2]), int(some.shape[3]))
    whole = {quality: _at_once(images, quality) for quality in OURS}
    limit = max(limits_ms(work(SPEC, True), size[0] * size[1], rates))
    for row in whole.values():
        row["limit_s"] = row["evaluations"] * limit / 1000
    of_some = hog(some, SPEC)
    shares = {quality: of_search(partial(reconstruct, of_some, SPEC, quality=quality)) for quality in OURS}
    return {"images": len(images), "few": len(some), "size": size, "rows": rows, "whole": whole, "shares": shares}


def _methods() -> dict[str, Callable[[Tensor], Tensor]]:
    """From images (1, 1, H, W) to pre-images; computing the descriptor counts, and is nothing beside the search."""
    return {
        **{name: partial(_ours, quality=name) for name in OURS},
        "CNN-HOG": partial(_cnn_hog, CNNHOG()),
        "CNN-HOGb": partial(_cnn_hog, CNNHOG(bilinear=True)),
        "paper": partial(_published, method=AsPublished()),
    }


def _ours(images: Tensor, quality: QualityName) -> Tensor:
    return reconstruct(hog(images, SPEC), SPEC, quality=quality).image


def _published(images: Tensor, method: AsPublished) -> Tensor:
    return reconstruct(hog(images, SPEC), SPEC, method=method).image


def _cnn_hog(network: CNNHOG, images: Tensor) -> Tensor:
    return network.reconstruct(network.descriptor(images)).image


def _keep(result: list[Tensor], method: Callable[[Tensor], Tensor], images: Tensor) -> None:
    result.append(method(images))


def _correlation(result: Tensor, images: Tensor) -> float:
    return fmean(metrics.cross_correlation(f, i) for f, i in zip(result[:, 0], images[:, 0], strict=True))


def _at_once(images: Tensor, quality: QualityName) -> dict[str, float]:
    """Seconds an image, of all in one batch, and how close they come."""
    clock, descriptors = Times(), hog(images, SPEC)
    result: list[Reconstruction] = []
    clock.add(lambda: result.append(reconstruct(descriptors, SPEC, quality=quality)))
    return {
        "cpu_s": clock.cpu[0] / 1000 / len(images),
        "wall_s": clock.wall[0] / 1000 / len(images),
        "cc": _correlation(result[0].image, images),
        "evaluations": float(result[0].evaluations.double().mean()),
    }


def poses(folder: Path | None, scenes: int, rates: Rates) -> dict[str, Any]:
    """Of scenes of known models, by each search.

    Args:
        folder: of CAD models; by default procedural chairs.
        scenes: how many.
        rates: of the machine.
    """
    examples = objects(scenes, folder)
    kinds = ("best", "exhaustive", "paper")
    errors: dict[str, list[float]] = {kind: [] for kind in kinds}
    renderings: dict[str, list[int]] = {kind: [] for kind in kinds}
    for example in examples:  # which prepares the models, too
        for kind in kinds:
            result = estimate(example, {"method": kind})
            errors[kind].append(float(azimuth_error(result.azimuth, example.azimuth)))
            renderings[kind].append(result.renderings)
    seconds: dict[str, list[float]] = {kind: [] for kind in kinds}
    for example in examples:
        for kind in kinds:
            seconds[kind].append(seconds_of(example, kind))
    meshes = [example.models[0].mesh() for example in examples]
    vertices, faces = (int(median(map(len, of))) for of in zip(*((m.vertices, m.faces) for m in meshes), strict=True))
    drawn = max(limits_ms(rendering_work(vertices, faces, CANVAS**2, False), 1, rates))
    limit = drawn + max(limits_ms(work(pose_spec(), False), CANVAS**2, rates))
    rows = {
        kind: {
            "limit_s": limit * median(renderings[kind]) / 1000,
            "cpu_s": summary(seconds[kind]),
            "renderings": median(renderings[kind]),
            "error": median(errors[kind]),
            "right": fmean(error < RADIUS for error in errors[kind]),
            "ratios": {p: ratio(seconds[p], seconds["best"]) for p in kinds[1:]} if kind == "best" else {},
        }
        for kind in kinds
    }
    shares = {kind: of_search(partial(estimate, examples[0], {"method": kind})) for kind in kinds[:2]}
    return {"scenes": len(examples), "faces": faces, "rows": rows, "shares": shares}
