"""Poses of chairs whose pose is known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.hog import presets
from nablahog.inputs.boxes import Box
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.pose.background import default_background
from nablahog.render import Camera, silhouette

from ..render.shapes import box as cuboid
from .common import SWIVEL, WOODEN, box_around, degrees_between, model, overlap, photographed

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


def test_the_pose_is_one_for_the_photograph(cluttered: Scene) -> None:
    """The box is away from the middle, so that a pose for the crop would not do."""
    image, box = cluttered
    estimate = estimate_pose(image, model(), box=box, initial=(0, 15))
    assert degrees_between(estimate.azimuth, 325) < 2
    assert (estimate.camera.height, estimate.camera.width) == image.shape[1:]
    covered = silhouette(model(), estimate.pose, estimate.camera)[0, 0] > 0.5
    assert all(abs(a - b) <= 4 for a, b in zip(box_around(covered), box, strict=True))
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


def test_one_mesh_or_a_mapping_or_a_list(clean: Scene) -> None:
    image, box = clean
    alone = estimate_pose(image, model(), box=box, initial=(0, 15))
    named = estimate_pose(image, {"my chair": model()}, box=box, initial=(0, 15))
    listed = estimate_pose(image, [model()], box=box, initial=(0, 15))
    assert (alone.model, named.model, listed.model) == ("", "my chair", "0")
    assert same(alone, named)
    assert same(alone, listed)


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
    assert calls[:2] == [(0, 2, "wooden"), (1, 2, "swivel")]
    assert [call[:2] for call in calls[2:]] == [(2, 2)]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["paper", "paper-edges"])
def test_the_papers_method_keeps_its_traces(clean: Scene, method: Any) -> None:
    image, box = clean
    models = {"chair": model(), "cuboid": cuboid((0.6, 0.5, 0.5))}
    estimate = estimate_pose(image, models, box=box, initial=(200, 18), method=method)
    assert (estimate.model, estimate.similarity_kind) == ("chair", "patches")
    assert degrees_between(estimate.azimuth, 215) < 10
    assert (estimate.elevation, estimate.theta) == (18, 0)
    assert [round(trace.azimuths[0]) for trace in estimate.traces] == 2 * [200, 0, 45, 90, 135, 180, 225, 270, 315]
    assert estimate.renderings == sum(len(trace.azimuths) for trace in estimate.traces)
    best = max(estimate.traces, key=lambda trace: max(trace.similarities))
    assert max(best.similarities) == estimate.similarity
    assert best.azimuths[best.similarities.index(estimate.similarity)] % 360 == pytest.approx(estimate.azimuth)


def test_exhaustive_search_is_of_whole_degrees(clean: Scene) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(200, 18), method="exhaustive")
    assert degrees_between(estimate.azimuth, 215) <= 1
    assert estimate.azimuth % 1 == 0
    assert (estimate.renderings, estimate.confidence) == (360, None)


def test_an_estimate_shows_its_pose_and_figures() -> None:
    camera = Camera.from_field_of_view(30, 60, 80)
    one = PoseEstimate(130.04, 12, 2.5, -1.25, 3, -4, camera, "wooden", 14.72, "calibrated", torch.zeros(6), 360, BOX)
    assert repr(one) == (
        "<PoseEstimate azimuth 130.0°, elevation 12.0°, theta -1.2°, distance 2.50, x 3.0, y -4.0, model wooden, "
        "calibrated similarity 14.7, 360 renderings>"
    )
    assert "model" not in repr(replace(one, model=""))
    assert "similarity 14.7, confidence 0.87, 360" in repr(replace(one, confidence=0.873))


def test_the_papers_similarity(clean: Scene) -> None:
    image, box = clean
    estimate = estimate_pose(image, model(), box=box, initial=(0, 18), similarity="patches")
    assert (estimate.similarity_kind, estimate.confidence) == ("patches", None)
    assert degrees_between(estimate.azimuth, 215) < 10


@pytest.mark.slow
def test_another_background(clean: Scene) -> None:
    image, box = clean
    background = default_background(presets.uoctti(16, colour="gray"), 4)
    estimate = estimate_pose(image, model(), box=box, initial=(0, 18), background=background)
    assert degrees_between(estimate.azimuth, 215) < 10


@pytest.mark.slow
@pytest.mark.parametrize("image", [torch.full((1, 60, 50), 0.5), torch.zeros(3, 200, 200)])
def test_where_there_is_nothing_to_see_any_pose_will_do(image: Tensor) -> None:
    for models in (model(), {"a": model(WOODEN), "b": model(SWIVEL)}):
        estimate = estimate_pose(image, models, initial=(0, 10))
        assert torch.isfinite(estimate.pose).all()
        assert math.isfinite(estimate.similarity)


@pytest.mark.parametrize(("unit", "origin"), [(1000.0, 0.0), (0.0254, 0.0), (1.0, 7.0)])
def test_units_and_origin_of_a_model_make_no_difference(clean: Scene, unit: float, origin: float) -> None:
    image, box = clean
    moved = replace(model(), vertices=model().vertices * unit + origin).normalized()
    one, other = (estimate_pose(image, each, box=box, focal=300.0, initial=(210, 15)) for each in (model(), moved))
    torch.testing.assert_close(other.pose, one.pose, rtol=1e-4, atol=1e-3)


@pytest.mark.slow
def test_the_smallest_photograph_and_box() -> None:
    """What the search finds may be smaller than what it is given."""
    image = torch.rand(1, 8, 8, generator=torch.Generator().manual_seed(0))
    for box in (None, (0, 0, 8, 8)):
        assert torch.isfinite(estimate_pose(image, model(), box=box).pose).all()


@pytest.mark.slow
def test_a_box_that_is_found_around_a_thin_object_can_be_given_again() -> None:
    rod = cuboid((1.0, 0.012, 0.012), 0.2).normalized()
    image, _ = photographed(rod, 20, 10)
    distortion = (0.2, 0, 0, 0)
    estimate = estimate_pose(image, rod, initial=(20, 10), within=30, focal=300, distortion=distortion)
    assert min(estimate.box.width, estimate.box.height) >= 8
    estimate_pose(image, rod, box=estimate.box, initial=(20, 10), within=30, focal=300, distortion=distortion)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": "aubry"}, "method must be one of 'best', 'paper', 'paper-edges', 'exhaustive', got 'aubry'"),
        ({"within": 10}, "`within` 10 needs `initial`"),
        ({"similarity": "cosine"}, "similarity must be one of 'patches', 'calibrated', got 'cosine'"),
        ({"initial": (0, 91)}, "elevation of initial must be a finite number in -90 … 90"),
        ({"box": (200, 0, 300, 150)}, "the image of 150x180 pixels"),
        ({"box": (0, 0, 7, 90)}, "the box must .* sides of at least 8 pixels"),
        ({"box": (0, 0, 1801, 90)}, "at most 10 times as large as the image of 150x180 pixels"),
        (
            {"models": {"chair": replace(model(), vertices=3 * model().vertices)}},
            "'chair' must .* of 1 .* got one of 3",
        ),
        ({"models": replace(model(), vertices=model().vertices + 0.3)}, r"0.52 off: write mesh\.normalized\(\)"),
        ({"photograph": torch.rand(1, 7, 40)}, "the photograph must have at least 8x8 pixels, got 7x40"),
        ({"photograph": torch.zeros(150, 180)}, r"must be a tensor \(1 or 3, H, W\) .*: write photograph\[None\]$"),
        ({"photograph": torch.zeros(150, 180, 3)}, r"write photograph\.permute\(2, 0, 1\)$"),
        ({"photograph": torch.zeros(1, 3, 150, 180)}, r"write photograph\[0\]$"),
        ({"photograph": np.zeros((150, 180), np.uint16)}, "write images / 65535"),
    ],
)
def test_refuses(clean: Scene, changes: dict[str, Any], message: str) -> None:
    options = {"photograph": clean[0], "models": model()} | changes
    with pytest.raises((ValueError, TypeError), match=message):
        estimate_pose(**options)


def test_an_object_that_is_there_is_surer_than_one_that_is_not() -> None:
    image, box = photographed(model(), 40, 15, behind="coffee")
    there = estimate_pose(image, model(), box=box)
    nothing = estimate_pose(torch.rand(1, 150, 180, generator=torch.Generator().manual_seed(0)), model(), box=box)
    assert there.confidence is not None
    assert nothing.confidence is not None
    assert there.confidence > 0.9
    assert nothing.confidence < 0.3


@pytest.mark.slow
def test_runners_up_are_other_sides_the_best_first() -> None:
    image, box = photographed(model(), 40, 15, behind="coffee")
    estimate = estimate_pose(image, {"wooden": model(WOODEN), "swivel": model(SWIVEL)}, box=box)
    assert estimate.runners_up
    shares = [one.share for one in estimate.runners_up]
    for one in estimate.runners_up:  # drawn as the best one is
        covered = silhouette(model(WOODEN if one.model == "wooden" else SWIVEL), one.pose, one.camera)[0, 0] > 0.5
        assert box_around(covered).iou(box) > 0.5
        assert one.matrix().shape == (4, 4)
    assert shares == sorted(shares, reverse=True)
    assert all(0 <= share <= 1 for share in shares)
    sides = [estimate.azimuth, *(one.azimuth for one in estimate.runners_up)]
    assert min(degrees_between(one, other) for k, one in enumerate(sides) for other in sides[:k]) > 15


@pytest.mark.slow
@pytest.mark.parametrize("method", ["best", "paper-edges"])
def test_each_pose_that_the_search_comes_to_is_watched(clean: Scene, method: Any) -> None:
    seen: list[tuple[str, Tensor]] = []
    options: dict[str, Any] = {"box": clean[1], "initial": (200, 18), "method": method}
    models = {"chair": model()}
    watched = estimate_pose(clean[0], models, watch=lambda *each: seen.append(each), **options)
    alone = estimate_pose(clean[0], models, **options)
    assert torch.equal(watched.crop_pose, alone.crop_pose)
    assert {name for name, _ in seen} == {"chair"}
    assert all(pose.shape == (6,) for _, pose in seen)
    nearest = min(float((pose - watched.crop_pose).abs().max()) for _, pose in seen)
    assert nearest < 0.5  # degrees, or pixels


def test_an_exception_ends_the_search(clean: Scene) -> None:
    class Enough(Exception):
        pass

    seen: list[Tensor] = []

    def watch(model: str, pose: Tensor) -> None:
        seen.append(pose.clone())
        raise Enough

    with pytest.raises(Enough):
        estimate_pose(clean[0], model(), box=clean[1], initial=(0, 20), watch=watch)
    with pytest.raises(Enough):
        estimate_pose(clean[0], model(), box=clean[1], method="paper", watch=watch)
    assert seen[-1][:2].tolist() == [0, 0]  # the paper's search begins at the front, at the height of the object


@pytest.mark.parametrize(("initial", "within"), [(205.0, 5.0), (45.0, 12.0)])
def test_no_azimuth_is_outside_of_the_bound(clean: Scene, initial: float, within: float) -> None:
    """The true one, 215, is outside: the search ends at the bound, or before it."""
    image, box = clean
    found = estimate_pose(image, model(), box=box, initial=(initial, 15), within=within)
    for one in (found, *found.runners_up):
        assert degrees_between(one.azimuth, initial) <= within + 1e-9
    with pytest.raises(ValueError, match="'best' alone"):
        estimate_pose(image, model(), box=box, initial=(initial, 15), within=within, method="exhaustive")
