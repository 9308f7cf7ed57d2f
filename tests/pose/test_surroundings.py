"""Where the box is rough, cut off or missing: its surroundings, at several scales and rotations."""

from __future__ import annotations

import dataclasses
import math
from unittest.mock import Mock

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog.gradient import gray
from nablahog.inputs.boxes import Box
from nablahog.io.images import sample_photograph
from nablahog.pose import PoseEstimate, detection, estimate_pose
from nablahog.pose.crop import CROP_FILL, crop_object
from nablahog.pose.detection import DETECTION_TILTS, find_boxes
from nablahog.pose.model import VIEW_COUNT, bounding_boxes, prepared_model, view_descriptors
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.problem import KNOWN_TILTS, UNKNOWN_TILTS
from nablahog.pose.surroundings import (
    FOUND,
    ROUGH,
    describe_surroundings,
    find_views,
    map_grid,
    turn_image,
)
from nablahog.render import Camera, pose, render, silhouette
from nablahog.render.camera import to_camera, to_screen

from .common import SWIVEL, WOODEN, box_around, degrees_between, model, photographed


@pytest.fixture(scope="module")
def photo() -> tuple[Tensor, PreparedPhotograph]:
    """A chair in front of a photograph, and its crop."""
    image, box = photographed(model(), 40, 15, behind="coffee")
    return image, PreparedPhotograph(crop_object(image, box))


@pytest.mark.parametrize(("tilt", "shape"), [(0.0, (8, 32)), (90.0, (32, 8))])
def test_cells_lie_in_an_image_that_is_wider_or_higher(tilt: float, shape: tuple[int, int]) -> None:
    """Also where a cell's middle is on its edge."""
    at, inside = detection._place_cells((3, 7), 8, tilt, shape)
    assert inside.tolist() == [[False] * 7, [False, *[True] * 5, False], [False] * 7]
    across = at[1, 1:6, 0] if tilt == 0 else at[1, 1:6, 1].abs()
    assert_close(across.abs(), torch.tensor([16, 8, 0, 8, 16], dtype=torch.float64))


def test_what_is_turned_counter_clockwise_is_upright_again() -> None:
    camera = Camera(300.0, 100, 100)
    upright, tilted = (render(model(), pose(40, 15, 4.0, theta), camera)[0, 0] for theta in (0, 30))
    (again,) = turn_image(tilted, [30], 1.0, (100, 100))
    assert float((again - upright).abs().mean()) < 0.015
    assert float((again - tilted).abs().mean()) > 0.05
    assert_close(turn_image(tilted, [0], 1.0, (100, 100))[0], tilted, atol=1e-5, rtol=0)


@pytest.mark.parametrize("tilt", [0.0, 25.0, -90.0])
def test_samples_of_a_turned_ramp_are_those_at_their_places(tilt: float) -> None:
    """Brightness 2x + 3y, from the middle, where the turned grid lies."""
    y, x = (torch.arange(n) - (n - 1) / 2 for n in (30, 50))
    (samples,) = turn_image(2 * x + 3 * y[:, None], [tilt], 1.5, (9, 12))
    grid = [torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in (9, 12)]
    at_x, at_y = (part[0] for part in map_grid(grid, torch.tensor([1.5]).double(), torch.tensor([tilt]).double()))
    cosine, sine = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    down, across = 1.5 * grid[0][:, None], 1.5 * grid[1]
    assert_close((at_x, at_y), (cosine * across + sine * down, cosine * down - sine * across))
    assert_close(samples.double(), 2 * at_x + 3 * at_y, rtol=0, atol=1e-4)


def test_the_window_of_the_box_is_the_template(photo: tuple[Tensor, PreparedPhotograph]) -> None:
    image, photograph = photo
    windows = describe_surroundings(photograph, image, [0], FOUND)
    (same,) = ((windows.scales == 1) & (windows.centres == 0).all(1)).nonzero()
    template = photograph.calibrated.weights.flatten()
    assert float(torch.corrcoef(torch.stack([windows.windows[same[0]], template]))[0, 1]) > 0.8


def test_the_best_view_is_where_the_object_is() -> None:
    """A box that is too large, and beside the object."""
    image, box = photographed(model(), 40, 15, behind="coffee")
    rough = box.x0 - 0.3 * box.width, box.y0 - 0.2 * box.height, box.x1 + 0.05 * box.width, box.y1 + 0.15 * box.height
    photograph = PreparedPhotograph(crop_object(image, rough))
    crop = photograph.crop
    one = prepared_model(model())
    everywhere = torch.ones(VIEW_COUNT, dtype=torch.bool)
    around = describe_surroundings(photograph, image, [-15, 0, 15], ROUGH)
    poses, similarities = find_views(one, photograph, around, [0, 15, 30], everywhere, 4)
    assert degrees_between(float(poses[0, 0]), 40) <= 7.5
    assert poses[0, 3] == 0
    assert list(similarities) == sorted(similarities, reverse=True)
    sides = bounding_boxes(poses[:1], one.hull, crop.camera)[0]
    expected = [(side - middle) * crop.zoom for side, middle in zip(box, crop.middle * 2, strict=True)]
    assert max(abs(float(side) - of) for side, of in zip(sides, expected, strict=True)) < 0.1 * CROP_FILL


def test_a_view_off_the_box_loses_a_known_part_of_its_similarity(photo: tuple[Tensor, PreparedPhotograph]) -> None:
    """The same windows said to be of twice the size, or half a side away: 5 % less each, 10 % for both."""
    image, photograph = photo
    one, everywhere = prepared_model(model()), torch.ones(VIEW_COUNT, dtype=torch.bool)
    windows = torch.stack([view_descriptors(one, 15)[5].flatten()] * 4)
    scales = torch.tensor([1.0, 2.0, 1.0, 0.5])
    centres = torch.tensor([[0, 0], [0, 0], [0, CROP_FILL / 2], [CROP_FILL / 2, 0]])
    scores = []
    for k in range(4):
        around = describe_surroundings(photograph, image, [0], FOUND)
        around = dataclasses.replace(
            around,
            windows=windows[k : k + 1],
            scales=scales[k : k + 1].double(),
            tilts=torch.zeros(1).double(),
            centres=centres[k : k + 1].double(),
        )
        scores.append(float(find_views(one, photograph, around, [15.0], everywhere, 1)[1][0]))
    assert scores[0] > 0
    assert [value / scores[0] for value in scores] == pytest.approx([1, 0.95, 0.95, 0.9])


def test_a_tilted_view_is_the_upright_one_turned_about_the_window(photo: tuple[Tensor, PreparedPhotograph]) -> None:
    image, photograph = photo
    one, everywhere = prepared_model(model()), torch.ones(VIEW_COUNT, dtype=torch.bool)
    scale, tilt, centre = 1.25, 25.0, torch.tensor([6.0, -9.0]).double()
    around = dataclasses.replace(
        describe_surroundings(photograph, image, [0], FOUND),
        windows=view_descriptors(one, 15)[5].flatten()[None],
        scales=torch.tensor([scale]).double(),
        tilts=torch.tensor([tilt]).double(),
        centres=centre[None],
    )
    poses, _ = find_views(one, photograph, around, [15.0], everywhere, 1)
    assert float(poses[0, 3]) == tilt
    camera = photograph.crop.camera
    seen = to_screen(to_camera(one.hull, poses), poses, camera)[0, :, :2] - camera.width / 2 - centre
    cosine, sine = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    upright = torch.stack([cosine * seen[:, 0] - sine * seen[:, 1], sine * seen[:, 0] + cosine * seen[:, 1]], 1)
    low, high = upright.amin(0), upright.amax(0)
    assert_close(low + high, torch.zeros(2).double(), rtol=0, atol=1e-3)
    assert float((high - low).max()) == pytest.approx(scale * CROP_FILL, abs=0.1)


AZIMUTH = 325.0


def changed(box: Box, left: float, top: float, right: float, bottom: float) -> Box:
    """A box whose sides are moved by shares of its width and height."""
    return Box(
        box.x0 + left * box.width, box.y0 + top * box.height, box.x1 + right * box.width, box.y1 + bottom * box.height
    )


def right(estimate: PoseEstimate, box: Box) -> bool:
    """Whether the azimuth is right, and the model where the object is."""
    covered = silhouette(model(), estimate.pose, estimate.camera)[0, 0] > 0.5
    return degrees_between(estimate.azimuth, AZIMUTH) < 3 and box_around(covered).iou(box) > 0.85


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
    box = box_around(silhouette(model(), at, camera)[0, 0] > 0.5)
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
    (box, *_) = find_boxes(torch.full((1, 300, 360), 0.5), [prepared_model(model())], None, 180.0, None)
    assert max(box.width, box.height) > 250


def test_places_are_more_where_the_model_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six at most, of one model; two of several, whose views take longer; tilts are tried to both sides."""
    image = gray(sample_photograph("coffee")[None])[0]
    models = [prepared_model(model(seed)) for seed in (WOODEN, SWIVEL)]
    counts = [len(find_boxes(image, some, (40.0, 20.0), 60.0, None)) for some in (models[:1], models)]
    assert 2 < counts[0] <= 6
    assert counts[1] == 2
    described = Mock(wraps=view_descriptors)
    monkeypatch.setattr(detection, "view_descriptors", described)
    monkeypatch.setattr(detection, "DETECTORS", 1)
    find_boxes(image, models, (40.0, 20.0), 60.0, None)
    assert {id(call.args[0]) for call in described.call_args_list} == {id(models[0])}
    for tilts in (DETECTION_TILTS, KNOWN_TILTS, UNKNOWN_TILTS):
        assert [-tilt for tilt in reversed(tilts)] == [*tilts]
