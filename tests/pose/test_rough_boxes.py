"""Poses where the box is rough, cut off or missing, and where the camera is tilted."""

from __future__ import annotations

import pytest
import torch

from nablahog.hog.box import Box
from nablahog.hog.gradient import gray
from nablahog.io.images import sample_photograph
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.pose.crop import typical_camera
from nablahog.pose.detection import find_boxes
from nablahog.pose.model import prepared_model
from nablahog.render import Camera, pose, render, silhouette

from .common import degrees_between, model, photographed

AZIMUTH = 325.0


def changed(box: Box, left: float, top: float, right: float, bottom: float) -> Box:
    """A box whose sides are moved by shares of its width and height."""
    return Box(
        box.x0 + left * box.width, box.y0 + top * box.height, box.x1 + right * box.width, box.y1 + bottom * box.height
    )


def right(estimate: PoseEstimate, box: Box) -> bool:
    """Whether the azimuth is right, and the model where the object is."""
    covered = silhouette(model(), estimate.pose, estimate.camera)[0, 0] > 0.5
    rows, cols = covered.nonzero().unbind(1)
    reached = Box(float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))
    return degrees_between(estimate.azimuth, AZIMUTH) < 3 and reached.iou(box) > 0.85


@pytest.mark.parametrize(
    "moved", [(-0.2, -0.2, 0.2, 0.2), (0.1, -0.1, 0.1, -0.1), (0, 0, 0, -0.3)], ids=["larger", "shifted", "lower"]
)
def test_a_rough_box(moved: tuple[float, float, float, float]) -> None:
    image, box = photographed(model(), AZIMUTH, 12, behind="coffee")
    rough = changed(box, *moved)
    estimate = estimate_pose(image, model(), box=rough, initial=(0, 12))
    assert right(estimate, box)
    assert estimate.box == rough


def test_an_object_that_the_border_cuts_off() -> None:
    image, box = photographed(model(), AZIMUTH, 12, behind="coffee")
    border = round(box.y1 - 0.25 * box.height)
    estimate = estimate_pose(image[:, :border], model(), box=(box.x0, box.y0, box.x1, border), initial=(0, 12))
    assert degrees_between(estimate.azimuth, AZIMUTH) < 5


@pytest.mark.parametrize("initial", [None, (0.0, 12.0)])
def test_no_box(initial: tuple[float, float] | None) -> None:
    image, box = photographed(model(), AZIMUTH, 12, behind="coffee")
    estimate = estimate_pose(image, model(), initial=initial)
    assert right(estimate, box)
    assert estimate.box.iou(box) > 0.6


@pytest.mark.parametrize("theta", [-40.0, 25.0])
def test_a_tilted_camera(theta: float) -> None:
    camera, at = Camera(300.0, 150, 180), pose(AZIMUTH, 12, 2.8, theta)
    behind = gray(sample_photograph("coffee")[None])[:, :, 100:250, 60:240]
    image = render(model(), at, camera, background=behind)[0]
    rows, cols = (silhouette(model(), at, camera)[0, 0] > 0.5).nonzero().unbind(1)
    box = Box(float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))
    estimate = estimate_pose(image, model(), box=box)
    assert right(estimate, box)
    assert abs(estimate.theta - theta) < 4


def test_the_pose_of_a_crop_is_that_of_the_given_box() -> None:
    """The search crops the object anew, but its pose is for the crop of the box that was given."""
    image, box = photographed(model(), AZIMUTH, 12, behind="coffee")
    seen: list[torch.Tensor] = []
    rough = changed(box, -0.3, -0.2, 0.1, 0.2)
    estimate = estimate_pose(image, model(), box=rough, initial=(0, 12), watch=lambda _, each: seen.append(each))
    assert min(float((each - estimate.crop_pose).abs().max()) for each in seen) < 1e-6


def test_where_there_is_nothing_to_see_the_largest_box_is_the_likeliest() -> None:
    (box, *_) = find_boxes(
        torch.full((1, 300, 360), 0.5), [prepared_model(model(), typical_camera())], None, 180.0, None
    )
    assert max(box.width, box.height) > 250
