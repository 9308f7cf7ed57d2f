"""What is known of the camera: its focal length, and about where it stands."""

from __future__ import annotations

import pytest
from torch import Tensor

from nablahog.hog.box import Box
from nablahog.pose import estimate_pose

from .common import degrees_between, model, photographed


@pytest.fixture(scope="module")
def scene() -> tuple[Tensor, Box]:
    return photographed(model(), 40, 15, behind="coffee")


@pytest.mark.parametrize("boxed", [True, False])
def test_with_the_focal_length_the_distance_is_the_true_one(scene: tuple[Tensor, Box], boxed: bool) -> None:
    """The scene is seen from 2.8 with a focal length of 300 pixels."""
    image, box = scene
    options = {"initial": (0, 15), **({"box": box} if boxed else {})}
    estimate = estimate_pose(image, model(), focal=300.0, **options)  # type: ignore[arg-type]
    assert degrees_between(estimate.azimuth, 40) < 2
    assert estimate.camera.focal == pytest.approx(300)
    assert abs(estimate.distance - 2.8) < 0.1
    longer = estimate_pose(image, model(), focal=600.0, **options)  # type: ignore[arg-type]
    assert abs(longer.distance - 5.6) < 0.3


@pytest.mark.parametrize("method", ["best", "exhaustive"])
def test_other_methods_take_it_too(scene: tuple[Tensor, Box], method: str) -> None:
    image, box = scene
    estimate = estimate_pose(image, model(), box=box, initial=(0, 15), focal=300.0, method=method)  # type: ignore[arg-type]
    assert abs(estimate.distance - 2.8) < 0.3


@pytest.mark.parametrize("boxed", [True, False])
def test_azimuths_near_the_initial_one_alone_are_searched(scene: tuple[Tensor, Box], boxed: bool) -> None:
    image, box = scene
    options = {"box": box} if boxed else {}
    anywhere = estimate_pose(image, model(), initial=(200, 15), **options)  # type: ignore[arg-type]
    assert degrees_between(anywhere.azimuth, 40) < 2
    for initial in (200, 60):
        near = estimate_pose(image, model(), initial=(initial, 15), within=30, **options)  # type: ignore[arg-type]
        assert degrees_between(near.azimuth, initial) < 45
    assert degrees_between(near.azimuth, 40) < 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"within": 0}, "within must be above 0 and at most 180"),
        ({"within": float("nan")}, "within must be above 0"),
        ({"focal": 0}, "focal must be a finite number of pixels above 0"),
        ({"focal": float("inf")}, "focal must be a finite number of pixels above 0"),
    ],
)
def test_refuses(scene: tuple[Tensor, Box], changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_pose(scene[0], model(), box=scene[1], **changes)  # type: ignore[arg-type]
