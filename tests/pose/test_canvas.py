"""The canvas: the photograph's own pixels where they need no change, and poses that mean the same on both."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog.gradient import gray
from nablahog.pose.canvas import FILL, SIDE, cut_out
from nablahog.pose.similarity import smaller_poses
from nablahog.render.camera import to_camera, to_screen


def screen(points: Tensor, pose: Tensor, camera: object) -> Tensor:
    return to_screen(to_camera(points, pose[None]), pose[None], camera)[0, :, :2]  # type: ignore[arg-type]


def test_at_zoom_1_it_is_the_photograph() -> None:
    photograph = torch.rand(3, 200, 220)
    canvas = cut_out(photograph, (50.0, 30.0, 50 + FILL, 110.0))
    assert (canvas.zoom, canvas.middle, canvas.size) == (1, (106, 70), (FILL, 80))
    assert_close(canvas.image, gray(photograph[None])[:, :, 6:134, 42:170], rtol=0, atol=1e-4)


def test_beyond_the_photograph_its_border_repeats() -> None:
    photograph = torch.rand(1, 112, 60)
    canvas = cut_out(photograph, (0.0, 0.0, 60.0, FILL))
    beside = (SIDE - 60) // 2
    assert_close(canvas.image[0, :, 8:120, beside:-beside], photograph, rtol=0, atol=1e-4)
    assert_close(canvas.image[0, 0, 8:120, :beside], photograph[0, :, :1].expand(-1, beside), rtol=0, atol=1e-4)
    assert_close(canvas.image[0, 0, 8:120, -beside:], photograph[0, :, -1:].expand(-1, beside), rtol=0, atol=1e-4)
    assert_close(canvas.image[0, 0, :8], canvas.image[0, 0, 8:9].expand(8, -1), rtol=0, atol=1e-4)
    assert canvas.seen == (beside, 8, SIDE - beside, 120)


def test_the_part_that_is_the_photograph() -> None:
    canvas = cut_out(torch.rand(3, 200, 220), (50.0, 30.0, 50 + 2 * FILL, 110.0))
    assert canvas.zoom == 0.5
    assert canvas.seen == pytest.approx((64 - 81, 64 - 35, 64 + 110 - 81, 64 + 100 - 35))


@pytest.mark.parametrize("box", [(10.0, 20.0, 38.0, 60.0), (33.5, 1.25, 90.0, 57.75), (-9.0, 40.0, 300.0, 600.0)])
def test_brightness_stays_where_it_is(box: tuple[float, ...]) -> None:
    """Of a photograph whose brightness grows evenly, each pixel of the canvas is known."""
    height, width = 240, 320
    x, y = torch.arange(width) + 0.5, torch.arange(height) + 0.5
    canvas = cut_out(((x / 320 + y[:, None] / 240) / 2)[None], box)
    at = (torch.arange(SIDE) + 0.5 - SIDE / 2) / canvas.zoom
    across, down = ((at + middle) for middle in canvas.middle)
    expected = (across / 320 + down[:, None] / 240) / 2
    # all that is smoothed has to be in the photograph
    reach = 0.5 + max(0, 3 / canvas.zoom)
    inner = ((down > reach) & (down < height - reach))[:, None] & (across > reach) & (across < width - reach)
    assert inner.sum() > 400
    assert_close(canvas.image[0, 0][inner], expected[inner], rtol=0, atol=2e-3)


@pytest.mark.parametrize("box", [(10.0, 20.0, 38.0, 60.0), (60.0, 1.25, 90.0, 557.75)])
def test_the_box_fills_it(box: tuple[float, ...]) -> None:
    canvas = cut_out(torch.zeros(1, 600, 300), box)
    assert canvas.image.shape == (1, 1, SIDE, SIDE)
    assert max(canvas.size) == pytest.approx(FILL)
    assert canvas.size[0] / canvas.size[1] == pytest.approx((box[2] - box[0]) / (box[3] - box[1]))
    assert canvas.middle == ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)


def test_what_is_shrunk_is_smoothed_first() -> None:
    """Rows of a pixel, white and black, are gray on a canvas of a fifth of the size, and no moiré."""
    photograph = (torch.arange(800) % 2).float()[:, None].expand(1, 800, 800)
    canvas = cut_out(photograph, (120.0, 120.0, 120 + 5 * FILL, 120 + 5 * FILL))
    assert (canvas.image - 0.5).abs().max() < 0.05


def test_gray_is_that_of_eq_1() -> None:
    photograph = torch.rand(3, 60, 60)
    box = (3.0, 5.0, 50.0, 55.0)
    assert torch.equal(cut_out(photograph, list(box)).image, cut_out(gray(photograph[None])[0], box).image)
    assert cut_out(photograph.double(), box).image.dtype == torch.float32


def test_one_camera_sees_all() -> None:
    cameras = {cut_out(torch.zeros(1, 90, 80), box).camera for box in ((0.0, 0.0, 80.0, 90.0), (5.0, 9.0, 20.0, 70.0))}
    assert len(cameras) == 1


def test_smaller_sees_the_same() -> None:
    canvas = cut_out(torch.rand(3, 375, 500), (282.0, 236.0, 365.0, 348.0))
    small = canvas.smaller(2)
    assert_close(small.image[0, 0, 3, 5], canvas.image[0, 0, 6:8, 10:12].mean())
    assert small.size == (canvas.size[0] / 2, canvas.size[1] / 2)
    assert small.seen == tuple(side / 2 for side in canvas.seen)
    points = torch.rand(20, 3, dtype=torch.float64) - 0.5
    pose = torch.tensor([40.0, 20.0, 2.7, -6.0, 3.5, -8.25], dtype=torch.float64)
    assert_close(2 * screen(points, smaller_poses(pose[None], 2)[0], small.camera), screen(points, pose, canvas.camera))


def test_a_pose_on_the_canvas_projects_to_the_same_points_of_the_photograph() -> None:
    canvas = cut_out(torch.rand(3, 375, 500), (282.0, 236.0, 365.0, 348.0))
    points = torch.rand(20, 3, dtype=torch.float64) - 0.5
    pose = torch.tensor([40.0, 20.0, 2.7, -6.0, 3.5, -8.25], dtype=torch.float64)
    moved, camera = canvas.in_photograph(pose, 375, 500)
    assert (camera.height, camera.width) == (375, 500)
    assert torch.equal(moved[:4], pose[:4])
    on_canvas = screen(points, pose, canvas.camera)
    expected = (on_canvas - SIDE / 2) / canvas.zoom + torch.tensor(canvas.middle)
    assert_close(screen(points, moved, camera), expected)


@pytest.mark.parametrize(
    ("photograph", "box", "message"),
    [
        (torch.zeros(90, 80), (0, 0, 80, 90), r"must be a floating point tensor \(1 or 3, H, W\), got"),
        (torch.zeros(2, 90, 80), (0, 0, 80, 90), r"got torch.float32 of shape \(2, 90, 80\)"),
        (torch.zeros(1, 90, 80).byte(), (0, 0, 80, 90), "got torch.uint8"),
        (torch.full((1, 90, 80), math.nan), (0, 0, 80, 90), "must be finite"),
        (torch.tensor([[[1.0, math.inf], [-math.inf, 1.0]]]).repeat(1, 45, 40), (0, 0, 80, 90), "must be finite"),
        (torch.zeros(1, 90, 80), (0, 0, 7, 90), "sides of at least 8 pixels"),
        (torch.zeros(1, 90, 80), (50, 10, 20, 60), "sides of at least 8 pixels"),
        (torch.zeros(1, 90, 80), (0, 0, math.inf, 90), "sides of at least 8 pixels"),
        (torch.zeros(1, 90, 80), (math.nan, 0, 80, 90), "sides of at least 8 pixels"),
        (torch.zeros(1, 90, 80), (80, 0, 120, 90), "must lie in the image of 90x80 pixels"),
        (torch.zeros(1, 90, 80), (0, -40, 40, 0), "must lie in the image of 90x80 pixels"),
    ],
)
def test_refuses(photograph: Tensor, box: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cut_out(photograph, box)
