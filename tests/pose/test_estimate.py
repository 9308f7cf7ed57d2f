"""Poses of chairs whose pose is known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog.hog import presets
from nablahog.hog.box import Box
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.pose.background import default_background
from nablahog.render import Camera, silhouette

from .common import SWIVEL, WOODEN, degrees_between, model, overlap, photographed

Scene = tuple[Tensor, Box]
BOX = Box(0.0, 0.0, 80.0, 60.0)


@pytest.fixture(scope="module")
def clean() -> Scene:
    return photographed(model(), 215, 18)


@pytest.fixture(scope="module")
def cluttered() -> Scene:
    return photographed(model(), 325, 12, behind="coffee")


def same(one: PoseEstimate, other: PoseEstimate) -> bool:
    return bool(torch.equal(one.pose, other.pose)) and one.similarity == other.similarity


@pytest.mark.parametrize("azimuth", [5, 120, 215])
def test_a_clean_rendering(azimuth: float) -> None:
    image, box = photographed(model(), azimuth, 18)
    estimate = estimate_pose(image, model(), box=box)
    assert degrees_between(estimate.azimuth, azimuth) < 2
    assert abs(estimate.elevation - 18) < 4
    assert abs(estimate.theta) < 3
    assert estimate.similarity_kind == "calibrated"
    assert estimate.renderings > 100
    (trace,) = [trace for trace in estimate.traces if trace.azimuths[-1] % 360 == estimate.azimuth]
    assert len(trace.azimuths) == 3  # a view all around, tilted, and the maximum
    assert list(trace.similarities) == sorted(trace.similarities)


def test_the_pose_is_one_for_the_photograph(cluttered: Scene) -> None:
    """The box is away from the middle, so that a pose for the crop would not do."""
    image, box = cluttered
    estimate = estimate_pose(image, model(), box=box, initial=(0, 15))
    assert degrees_between(estimate.azimuth, 325) < 2
    assert (estimate.camera.height, estimate.camera.width) == image.shape[1:]
    covered = silhouette(model(), estimate.pose, estimate.camera)[0, 0] > 0.5
    rows, cols = covered.nonzero().unbind(1)
    reached = (cols.min(), rows.min(), cols.max() + 1, rows.max() + 1)
    assert all(abs(float(a) - b) <= 4 for a, b in zip(reached, box, strict=True))
    clean, _ = photographed(model(), 325, 12)
    assert overlap(covered, clean[0] < 0.999) > 0.75


def test_colour_and_precision_make_no_difference(clean: Scene) -> None:
    image, box = clean
    options: dict[str, Any] = {"box": list(box), "initial": [210, 15]}
    estimate = estimate_pose(image, model(), **options)
    assert same(estimate_pose(image.double(), model(), **options), estimate)
    in_colour = estimate_pose(image.expand(3, -1, -1), model(), **options)
    assert degrees_between(in_colour.azimuth, estimate.azimuth) < 0.5


def test_the_seed_decides(cluttered: Scene) -> None:
    image, box = cluttered
    estimate = [estimate_pose(image, model(), box=box, initial=(300, 15), seed=seed) for seed in (5, 5, 6)]
    assert same(estimate[0], estimate[1])
    assert not same(estimate[0], estimate[2])
    assert degrees_between(estimate[0].azimuth, estimate[2].azimuth) < 2


def test_one_mesh_or_a_mapping(clean: Scene) -> None:
    image, box = clean
    alone = estimate_pose(image, model(), box=box, initial=(0, 15))
    named = estimate_pose(image, {"my chair": model()}, box=box, initial=(0, 15))
    assert (alone.model, named.model) == ("", "my chair")
    assert same(alone, named)


@pytest.mark.parametrize("method", ["best", "exhaustive"])
def test_of_several_models_it_is_the_right_one(method: Any) -> None:
    models = {"wooden": model(WOODEN), "swivel": model(SWIVEL)}
    calls: list[tuple[int, int, str]] = []
    image, box = photographed(models["swivel"], 60, 15, behind="coffee")
    estimate = estimate_pose(
        image, models, box=box, initial=(0, 15), method=method, progress=lambda *call: calls.append(call)
    )
    assert estimate.model == "swivel"
    assert degrees_between(estimate.azimuth, 60) < 3
    assert calls == [(0, 2, "wooden"), (1, 2, "swivel")]


@pytest.mark.parametrize("method", ["paper", "paper-edges"])
def test_the_papers_method_keeps_its_traces(clean: Scene, method: Any) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(200, 18), method=method)
    assert estimate.similarity_kind == "patches"
    assert degrees_between(estimate.azimuth, 215) < 10
    assert (estimate.elevation, estimate.theta) == (18, 0)
    assert [round(trace.azimuths[0]) for trace in estimate.traces] == [200, 0, 45, 90, 135, 180, 225, 270, 315]
    assert estimate.renderings == sum(len(trace.azimuths) for trace in estimate.traces)
    best = max(estimate.traces, key=lambda trace: max(trace.similarities))
    assert max(best.similarities) == estimate.similarity
    assert best.azimuths[best.similarities.index(estimate.similarity)] % 360 == pytest.approx(estimate.azimuth)


def test_exhaustive_search_is_of_whole_degrees(clean: Scene) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(200, 18), method="exhaustive")
    assert degrees_between(estimate.azimuth, 215) <= 1
    assert estimate.azimuth % 1 == 0
    assert estimate.renderings == 360


def test_an_estimate_shows_its_pose_and_figures() -> None:
    camera = Camera.from_field_of_view(30, 60, 80)
    one = PoseEstimate(130.04, 12, 2.5, -1.25, 3, -4, camera, "wooden", 14.72, "calibrated", torch.zeros(6), 360, BOX)
    assert repr(one) == (
        "<PoseEstimate azimuth 130.0°, elevation 12.0°, theta -1.2°, distance 2.50, x 3.0, y -4.0, model wooden, "
        "calibrated similarity 14.7, 360 renderings>"
    )
    assert "model" not in repr(replace(one, model=""))
    assert "similarity 14.7, confidence 0.87, 360" in repr(replace(one, confidence=0.873))


@pytest.mark.parametrize("ascent", ["momentum", "lbfgs"])
def test_other_ascents(clean: Scene, ascent: Any) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(0, 18), ascent=ascent)
    assert degrees_between(estimate.azimuth, 215) < 4


@pytest.mark.parametrize("similarity", ["patches", "whitened"])
def test_other_similarities(clean: Scene, similarity: Any) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(0, 18), similarity=similarity)
    assert estimate.similarity_kind == similarity
    assert degrees_between(estimate.azimuth, 215) < 10


def test_another_background(clean: Scene) -> None:
    image, box = clean
    background = default_background(presets.uoctti(16, colour="gray"), 4)
    estimate = estimate_pose(image, model(), box=box, initial=(0, 18), similarity="whitened", background=background)
    assert degrees_between(estimate.azimuth, 215) < 10


@pytest.mark.parametrize("image", [torch.full((1, 60, 50), 0.5), torch.zeros(3, 200, 200)])
def test_where_there_is_nothing_to_see_any_pose_will_do(image: Tensor) -> None:
    for models in (model(), {"a": model(WOODEN), "b": model(SWIVEL)}):
        estimate = estimate_pose(image, models, initial=(0, 10))
        assert torch.isfinite(estimate.pose).all()
        assert math.isfinite(estimate.similarity)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"models": {}}, "at least one model, got none"),
        ({"method": "aubry"}, "method must be one of 'best', 'paper', 'paper-edges', 'exhaustive', got 'aubry'"),
        ({"ascent": "sgd"}, "ascent must be one of 'quadratic', 'momentum', 'lbfgs', got 'sgd'"),
        ({"similarity": "cosine"}, "similarity must be one of 'patches', 'whitened', 'calibrated', got 'cosine'"),
        ({"initial": (math.nan, 0)}, "finite azimuth and an elevation in -90…90"),
        ({"initial": (0, 0, 0)}, "finite azimuth and an elevation in -90…90"),
        ({"initial": (0, 91)}, "finite azimuth and an elevation in -90…90"),
        ({"box": (200, 0, 300, 150)}, "must lie in the image of 150x180 pixels"),
        ({"box": (0, 0, 5, 150)}, "sides of at least 8 pixels"),
        ({"photograph": torch.zeros(150, 180)}, r"must be a floating point tensor \(1 or 3, H, W\)"),
        ({"photograph": torch.full((1, 150, 180), math.nan)}, "must be finite"),
    ],
)
def test_refuses(clean: Scene, changes: dict[str, Any], message: str) -> None:
    options = {"photograph": clean[0], "models": model()} | changes
    with pytest.raises(ValueError, match=message):
        estimate_pose(**options)
