"""The crop, poses that mean the same on it and on the photograph, and what is known of the camera."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image
from torch import Tensor
from torch.nn import functional
from torch.testing import assert_close

from nablahog.hog.gradient import gray
from nablahog.inputs.boxes import Box
from nablahog.pose import PoseEstimate, estimate_pose
from nablahog.pose.crop import CROP_FILL, CROP_SIDE, apply_mask, crop_object
from nablahog.pose.crop_view import gray_means, reduction_factor
from nablahog.pose.similarity import downsample_poses
from nablahog.render import pose, render
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.conventions import move_before_camera, pose_matrix, turn_to

from .common import box_around, degrees_between, errors, model, photographed


def screen(points: Tensor, pose: Tensor, camera: object) -> Tensor:
    return to_screen(to_camera(points, pose[None]), pose[None], camera)[0, :, :2]  # type: ignore[arg-type]


def test_at_zoom_1_it_is_the_photograph() -> None:
    photograph = torch.rand(3, 200, 220)
    crop = crop_object(photograph, (50.0, 30.0, 50 + CROP_FILL, 110.0))
    assert (crop.zoom, crop.middle, crop.size) == (1, (106, 70), (CROP_FILL, 80))
    assert_close(crop.image, gray(photograph[None])[:, :, 6:134, 42:170], rtol=0, atol=1e-4)


def test_beyond_the_photograph_its_border_repeats() -> None:
    photograph = torch.rand(1, 112, 60)
    crop = crop_object(photograph, (0.0, 0.0, 60.0, CROP_FILL))
    beside = (CROP_SIDE - 60) // 2
    assert_close(crop.image[0, :, 8:120, beside:-beside], photograph, rtol=0, atol=1e-4)
    assert_close(crop.image[0, 0, 8:120, :beside], photograph[0, :, :1].expand(-1, beside), rtol=0, atol=1e-4)
    assert_close(crop.image[0, 0, 8:120, -beside:], photograph[0, :, -1:].expand(-1, beside), rtol=0, atol=1e-4)
    assert_close(crop.image[0, 0, :8], crop.image[0, 0, 8:9].expand(8, -1), rtol=0, atol=1e-4)
    assert crop.valid == (beside, 8, CROP_SIDE - beside, 120)


def test_without_a_box_it_is_of_the_whole_photograph() -> None:
    photograph = torch.rand(1, 112, 60)
    crop = crop_object(photograph)
    assert (crop.middle, crop.size) == ((30, 56), (60, CROP_FILL))
    assert_close(crop.image, crop_object(photograph, (0.0, 0.0, 60.0, CROP_FILL)).image)


@pytest.mark.parametrize("box", [(10.0, 20.0, 38.0, 60.0), (33.5, 1.25, 90.0, 57.75), (-9.0, 40.0, 300.0, 600.0)])
def test_brightness_stays_where_it_is(box: tuple[float, ...]) -> None:
    """Of a photograph whose brightness grows evenly, each pixel of the crop is known."""
    height, width = 240, 320
    x, y = torch.arange(width) + 0.5, torch.arange(height) + 0.5
    crop = crop_object(((x / 320 + y[:, None] / 240) / 2)[None], box)
    at = (torch.arange(CROP_SIDE) + 0.5 - CROP_SIDE / 2) / crop.zoom
    across, down = ((at + middle) for middle in crop.middle)
    expected = (across / 320 + down[:, None] / 240) / 2
    # all that is smoothed has to be in the photograph
    reach = 0.5 + max(0, 3 / crop.zoom)
    inner = ((down > reach) & (down < height - reach))[:, None] & (across > reach) & (across < width - reach)
    assert inner.sum() > 400
    assert_close(crop.image[0, 0][inner], expected[inner], rtol=0, atol=2e-3)


@pytest.mark.parametrize("box", [(10.0, 20.0, 38.0, 60.0), (60.0, 1.25, 90.0, 557.75)])
def test_the_box_fills_it(box: tuple[float, ...]) -> None:
    crop = crop_object(torch.zeros(1, 600, 300), box)
    assert crop.image.shape == (1, 1, CROP_SIDE, CROP_SIDE)
    assert max(crop.size) == pytest.approx(CROP_FILL)
    assert crop.size[0] / crop.size[1] == pytest.approx((box[2] - box[0]) / (box[3] - box[1]))
    assert crop.middle == ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)


@pytest.mark.parametrize("box", [(10.0, 20.0, 38.0, 60.0), (200.0, 20.0, 290.0, 110.0)])
def test_the_box_fills_what_a_turned_camera_sees(box: tuple[float, ...]) -> None:
    """Which sees a box beside the axis smaller; of the same sides in the crop as in its size."""
    crop = crop_object(torch.zeros(1, 240, 300), box, focal=200.0, axis=(150.0, 120.0))
    assert max(crop.size) == pytest.approx(CROP_FILL)
    assert crop.zoom > CROP_FILL / max(box[2] - box[0], box[3] - box[1])
    assert crop.camera.focal == pytest.approx(200 * crop.zoom)


def test_a_box_of_a_turned_camera_goes_through_the_middles_of_its_sides() -> None:
    crop = crop_object(torch.zeros(1, 240, 300), (10.0, 20.0, 38.0, 60.0), focal=200.0, axis=(150.0, 120.0))
    found = crop.box_in_photograph(torch.tensor([-30.0, -10, 20, 40], dtype=torch.float64))
    left, upper, right, lower = (-30.0, 15.0), (-5.0, -10.0), (20.0, 15.0), (-5.0, 40.0)
    across, down = crop.to_photograph(*torch.tensor([left, upper, right, lower], dtype=torch.float64).T)
    assert found == pytest.approx((float(across[0]), float(down[1]), float(across[2]), float(down[3])))


@pytest.mark.parametrize(("factor", "most"), [(5, 0.05), (1.6, 0.15)])
def test_what_is_shrunk_is_smoothed_first(factor: float, most: float) -> None:
    """Rows of a pixel, white and black, are gray on a smaller crop, and no moiré."""
    photograph = (torch.arange(800) % 2).float()[:, None].expand(1, 800, 800)
    crop = crop_object(photograph, (120.0, 120.0, 120 + factor * CROP_FILL, 120 + factor * CROP_FILL))
    assert (crop.image - 0.5).abs().max() < most


@pytest.mark.parametrize("known", [{}, {"focal": 400.0, "axis": (90.0, 310.0)}])
def test_smaller_sees_the_same(known: dict[str, Any]) -> None:
    crop = crop_object(torch.rand(3, 375, 500), (282.0, 236.0, 365.0, 348.0), **known)
    small = crop.downsample(2)
    assert_close(small.image[0, 0, 3, 5], crop.image[0, 0, 6:8, 10:12].mean())
    assert small.size == (crop.size[0] / 2, crop.size[1] / 2)
    assert small.valid == tuple(side / 2 for side in crop.valid)
    points = torch.rand(20, 3, dtype=torch.float64) - 0.5
    pose = torch.tensor([40.0, 20.0, 2.7, -6.0, 3.5, -8.25], dtype=torch.float64)
    assert_close(
        2 * screen(points, downsample_poses(pose[None], 2)[0], small.camera), screen(points, pose, crop.camera)
    )
    x, y = torch.tensor([-40.0, 10, 25], dtype=torch.float64), torch.tensor([6.0, -31, 50], dtype=torch.float64)
    assert_close(small.to_photograph(x / 2, y / 2), crop.to_photograph(x, y))
    assert small.twist(2, -3) == pytest.approx(crop.twist(4, -6))


def test_a_pose_in_the_crop_of_a_known_camera_projects_to_the_same_points_of_the_photograph() -> None:
    """Crop, photograph and 4x4 matrix draw the same mesh, with the optical axis far off the middle, and tilted.

    A crop's pixel (x, y) is the ray that its camera, turned to the crop's middle, sends through it; the same ray of
    the camera that looks along the axis meets the photograph at intrinsics times it.
    """
    height, width, axis, focal = 375, 500, (90.0, 310.0), 400.0
    crop = crop_object(torch.rand(3, height, width), (282.0, 36.0, 365.0, 148.0), focal=focal, axis=axis)
    pose = torch.tensor([40.0, 20.0, 2.7, -6.0, 13.5, -18.25], dtype=torch.float64)
    moved, camera = crop.place_in_photograph(pose, height, width)
    mesh = model()
    estimate = PoseEstimate(*moved.tolist(), camera, "", 0.0, "calibrated", pose, 1, Box(0, 0, 9, 9))
    estimate = replace(estimate, principal_point=axis, from_original=mesh.from_original)
    inverse = torch.linalg.inv(mesh.from_original)
    points = mesh.vertices @ inverse[:3, :3].T + inverse[:3, 3]
    matrix, intrinsics = estimate.matrix(), estimate.intrinsics
    seen = (points @ matrix[:3, :3].T + matrix[:3, 3]) @ intrinsics.T
    by_matrix = seen[:, :2] / seen[:, 2:]
    drawn, at, render_camera = estimate.render_arguments(mesh)
    assert_close(screen(drawn.vertices, at[0], render_camera), by_matrix)
    # by hand: the object in the frame of the crop's camera, whose principal point is x, y beside the object's ray
    x, y = float(pose[4]) / crop.camera.focal, float(pose[5]) / crop.camera.focal
    to_object = turn_to(torch.tensor([x, y, 1.0], dtype=torch.float64))
    middle = torch.tensor([*crop.middle, focal], dtype=torch.float64)
    to_crop = turn_to(middle - torch.tensor([*axis, 0.0], dtype=torch.float64))
    motion = pose_matrix(pose)
    in_camera = (mesh.vertices @ motion[:3, :3].T + motion[:3, 3]) @ to_object @ to_crop
    by_hand = (in_camera / in_camera[:, 2:] * focal)[:, :2] + torch.tensor(axis)
    assert_close(by_matrix, by_hand, rtol=0, atol=1e-3)
    back = crop.convert_pose(pose, crop)
    assert_close(back, pose, rtol=0, atol=1e-3)


def test_a_pose_is_converted_between_crops_of_a_known_camera() -> None:
    photograph, axis = torch.rand(1, 375, 500), (90.0, 310.0)
    one, other = (
        crop_object(photograph, box, focal=400.0, axis=axis)
        for box in ((282.0, 36.0, 365.0, 148.0), (200.0, 100.0, 400.0, 180.0))
    )
    pose = torch.tensor([40.0, 20.0, 2.7, -6.0, 3.5, -8.25], dtype=torch.float64)
    converted = one.convert_pose(pose, other)
    assert_close(
        other.place_in_photograph(converted, 375, 500)[0], one.place_in_photograph(pose, 375, 500)[0], rtol=0, atol=1e-3
    )
    assert abs(float(converted[3] - pose[3])) > 0.5  # degrees: the two cameras are turned differently


@pytest.mark.parametrize(
    ("photograph", "box", "message"),
    [
        (
            torch.zeros(90, 80),
            (0, 0, 80, 90),
            r"must be a tensor \(1 or 3, H, W\) of floating point numbers or uint8, got",
        ),
        (torch.zeros(1, 90, 80).int(), (0, 0, 80, 90), "got torch.int32"),
        (torch.tensor([[[1.0, math.inf], [-math.inf, 1.0]]]).repeat(1, 45, 40), (0, 0, 80, 90), "must be finite"),
        (torch.zeros(1, 90, 80), (0, 0, 0.5, 90), "sides of at least 1 pixels"),
        (torch.zeros(1, 100, 200), (0.25, 0.5, 0.75, 1), r"of parts of the sides write \(50.0, 50.0, 150.0, 100"),
        (torch.zeros(1, 90, 80), (80, 0, 120, 90), "the image of 90x80 pixels"),
    ],
)
def test_refuses_photographs_and_boxes(photograph: Tensor, box: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        crop_object(photograph, box)


def test_what_is_around_does_not_count() -> None:
    clean, box = photographed(model(), 325, 12)
    mask = clean[0] < 0.999
    poses = []
    for behind in ("coffee", "cat"):
        image, _ = photographed(model(), 325, 12, behind=behind)
        inside, own = apply_mask(torch.where(mask, clean, image), mask)
        assert max(abs(one - other) for one, other in zip(own, box, strict=True)) <= 1
        assert torch.equal(inside[:, mask], clean[:, mask])
        assert len(inside[:, ~mask].unique()) == 1
        estimate = estimate_pose(image, model(), mask=mask.numpy())
        assert degrees_between(estimate.azimuth, 325) < 2
        poses.append(estimate.pose)
    assert float((poses[0] - poses[1]).abs().max()) < 1.5


def test_a_box_may_be_given_too() -> None:
    _, box = apply_mask(torch.rand(1, 20, 30), torch.ones(20, 30, dtype=torch.bool), (1, 2, 25, 18))
    assert box == Box(1, 2, 25, 18)


@pytest.fixture(scope="module")
def scene() -> tuple[Tensor, Box]:
    return photographed(model(), 40, 15, behind="coffee")


@pytest.mark.parametrize("boxed", [True, False])
def test_with_the_focal_length_the_distance_is_the_true_one(scene: tuple[Tensor, Box], boxed: bool) -> None:
    """The scene is seen from 2.8 with a focal length of 300 pixels."""
    image, box = scene
    options = {"initial": (0, 15), **({"box": box} if boxed else {})}
    estimate = estimate_pose(image, model(), focal=np.float32(300), **options)  # type: ignore[arg-type]
    assert degrees_between(estimate.azimuth, 40) < 2
    assert estimate.camera.focal == pytest.approx(300)
    assert abs(estimate.distance - 2.8) < 0.1
    longer = estimate_pose(image, model(), focal=600.0, **options)  # type: ignore[arg-type]
    assert abs(longer.distance - 5.6) < 0.3


@pytest.mark.slow
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


def test_the_lens_of_a_photograph_s_file(scene: tuple[Tensor, Box]) -> None:
    image, box = scene
    exif, file = Image.Exif(), io.BytesIO()
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 50}
    Image.fromarray((image[0] * 255).round().byte().numpy()).save(file, "png", exif=exif)
    photo = Image.open(file)
    estimate = estimate_pose(photo, model(), box=box, initial=(0, 15), focal="exif", method="exhaustive")
    assert estimate.camera.focal == pytest.approx(50 / math.hypot(36, 24) * math.hypot(150, 180))
    assert (estimate.focal_from, estimate.principal_point) == ("exif", (90, 75))
    for without in (image, Image.fromarray(np.zeros((60, 60), np.uint8))):
        with pytest.raises(ValueError, match="`focal` 'exif' needs an uncropped photograph"):
            estimate_pose(without, model(), focal="exif")


def test_a_pose_beside_the_optical_axis_is_that_of_the_camera() -> None:
    """A chair 25° beside the axis of a wide lens, whose principal point is not the middle either."""
    axis, focal = (338.0, 229.0), 420.0
    intrinsics = torch.tensor([[focal, 0, axis[0]], [0, focal, axis[1]], [0, 0, 1]], dtype=torch.float64)
    matrix = pose_matrix(pose(35, 18, 2.6, 3)[0])
    matrix[:3, 3] += matrix.new_tensor([1.2, -0.35, 0])
    image = render(*move_before_camera(model(), matrix, intrinsics, 480, 640))[0]
    box = box_around(image[0] < 1)
    estimate = estimate_pose(image, model(), box=box, focal=focal, principal_point=axis)
    assert_close(estimate.intrinsics, intrinsics)
    degrees, off = errors(estimate, matrix)
    assert degrees < 2.5
    assert off < 0.08


@pytest.mark.slow
@pytest.mark.parametrize(("height", "width"), [(6, 9), (7, 8), (8, 7)])
def test_means_repeat_the_border(height: int, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.pose.crop_view.STRIP_PIXELS", 4 * 3 * width)  # strips of 4 rows of means
    picture = torch.rand(1, height, width)
    rows, cols = (torch.arange(-(-side // 3) * 3).clamp(max=side - 1) for side in (height, width))
    expected = functional.avg_pool2d(picture[:, rows][:, :, cols], 3)
    assert_close(gray_means(picture, 3), expected)


@pytest.mark.parametrize("axis", [None, (2200.0, 1800.0)])
def test_large_photographs_are_shrunk_in_two_steps(
    axis: tuple[float, float] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A smooth picture is the same in a crop whether the photograph has 40 times as many pixels along a side or not."""
    side, factor = 120, 40
    box = (30.0, 25.0, 90.0, 88.0)

    def picture(size: int) -> Tensor:
        at = (torch.arange(size, dtype=torch.float64) + 0.5) / size
        return (0.5 + 0.4 * torch.sin(9 * at)[:, None] * torch.cos(7 * at))[None].float()

    large = picture(side * factor)
    known: dict[str, Any] = {} if axis is None else {"focal": 6000.0, "axis": axis}
    crop = crop_object(large, [factor * each for each in box], **known)
    assert reduction_factor(crop.zoom) == 2
    small: dict[str, Any] = (
        {} if axis is None else {"focal": 6000.0 / factor, "axis": tuple(each / factor for each in axis)}
    )
    assert_close(crop.image, crop_object(picture(side), box, **small).image, atol=4e-3, rtol=0)
    of_bytes = crop_object((large * 255).round().byte(), [factor * each for each in box], **known)
    assert_close(of_bytes.image, crop.image, atol=2e-3, rtol=0)
    monkeypatch.setattr("nablahog.pose.crop_view.STRIP_PIXELS", 7 * side * factor)
    in_strips = crop_object(large, [factor * each for each in box], **known)
    assert_close(in_strips.image, crop.image, atol=1e-6, rtol=0)
