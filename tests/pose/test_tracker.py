"""An object followed through short videos: where it is, when it is gone, and that it is found again."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from nablahog.hog.gradient import gray
from nablahog.io.sample_photographs import sample_photograph
from nablahog.pose import Tracker
from nablahog.pose.tracker import SEARCH_EVERY
from nablahog.render import Camera, pose, render

from .common import degrees_between, model

CAMERA = Camera(300.0, 150, 180)


def true_pose(k: int) -> Tensor:
    """A chair that turns by 3° and moves by 2 pixels a frame."""
    return pose(40 + 3 * k, 15 + k / 2, 2.8 - 0.02 * k, x=-15 + 2 * k, y=-8)


def background() -> Tensor:
    return gray(sample_photograph("coffee")[None])[:, :, 100:250, 60:240]


def frame(k: int) -> Tensor:
    return render(model(), true_pose(k), CAMERA, background=background())[0]


def empty() -> Tensor:
    return background()[0]


@pytest.fixture
def tracker() -> Tracker:
    return Tracker(model(), focal=300.0, initial=(40, 15))


def test_it_follows(tracker: Tracker) -> None:
    for k in range(8):
        estimate = tracker(frame(k))
        assert estimate is not None
        azimuth, elevation, distance, _, x, y = true_pose(k)[0].tolist()
        assert degrees_between(estimate.azimuth, azimuth) < 4
        assert abs(estimate.elevation - elevation) < 4
        assert abs(estimate.distance - distance) < 0.15
        assert abs(estimate.x - x) < 2.5
        assert abs(estimate.y - y) < 2.5
        assert estimate.camera.focal == pytest.approx(300)
        assert estimate.focal_from == "given"
        assert k == 0 or estimate.renderings < 60
    assert tracker.lost == 0


def test_what_is_gone_is_lost_and_found_again(tracker: Tracker) -> None:
    assert tracker(frame(0)) is not None
    assert tracker(frame(1)) is not None
    for k in range(3):
        assert tracker(empty()) is None
        assert tracker.lost == k + 1
    far = torch.cat([frame(6), empty()], 2)[:, :, -180:]  # an empty frame of the same size
    assert tracker(far) is None
    # at another place, from another side: as soon as the whole frame is searched
    away = render(model(), pose(150, 20, 3.2, x=30, y=5), CAMERA, background=background())[0]
    found = [tracker(away) for _ in range(SEARCH_EVERY + 1)]
    seen = [estimate for estimate in found if estimate is not None]
    assert seen
    assert degrees_between(seen[-1].azimuth, 150) < 6
    assert tracker.lost == 0


def test_without_a_focal_length_it_keeps_the_one_it_assumed() -> None:
    tracker = Tracker(model(), initial=(40, 15))
    estimates = [tracker(frame(k).expand(3, -1, -1).permute(1, 2, 0).numpy()) for k in range(4)]
    assert len({round(estimate.camera.focal, 6) for estimate in estimates if estimate is not None}) == 1
    assert all(estimate is not None and estimate.focal_from == "assumed" for estimate in estimates)


def test_it_is_the_same_every_time() -> None:
    runs = []
    for _ in range(2):
        tracker = Tracker(model(), focal=300.0, initial=(40, 15), seed=3)
        runs.append([tracker(frame(k)) for k in range(3)])
    for one, other in zip(*runs, strict=True):
        assert one is not None
        assert other is not None
        assert torch.equal(one.pose, other.pose)
