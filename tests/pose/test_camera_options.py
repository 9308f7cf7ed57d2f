"""What is known of the camera: its focal length, and about where it stands."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog.box import Box
from nablahog.pose import estimate_pose
from nablahog.render import pose, render
from nablahog.render.conventions import moved_before, pose_matrix

from .common import box_around, degrees_between, model, photographed


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
        ({"principal_point": (3, 4)}, "principal_point says something only of a camera of known focal length"),
        ({"focal": 300, "principal_point": (3, math.nan)}, "principal_point must be two finite numbers of pixels"),
        ({"focal": "far"}, "focal must be a finite number of pixels above 0, or 'exif', got 'far'"),
    ],
)
def test_refuses_what_is_no_camera(scene: tuple[Tensor, Box], changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_pose(scene[0], model(), box=scene[1], **changes)  # type: ignore[arg-type]


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
        with pytest.raises(ValueError, match="focal='exif' needs a PIL image whose EXIF data has a focal length"):
            estimate_pose(without, model(), focal="exif")


def test_a_pose_beside_the_optical_axis_is_that_of_the_camera() -> None:
    """A chair 25° beside the axis of a wide lens, whose principal point is not the middle either."""
    axis, focal = (338.0, 229.0), 420.0
    intrinsics = torch.tensor([[focal, 0, axis[0]], [0, focal, axis[1]], [0, 0, 1]], dtype=torch.float64)
    matrix = pose_matrix(pose(35, 18, 2.6, 3)[0])
    matrix[:3, 3] += matrix.new_tensor([1.2, -0.35, 0])
    image = render(*moved_before(model(), matrix, intrinsics, 480, 640))[0]
    box = box_around(image[0] < 1)
    estimate = estimate_pose(image, model(), box=box, focal=focal, principal_point=axis)
    assert_close(estimate.intrinsics, intrinsics)
    result = (estimate.matrix() @ torch.linalg.inv(estimate.from_original)) / torch.tensor(
        [model().unit] * 3 + [1], dtype=torch.float64
    )[:, None]
    cosine = (float((result[:3, :3] @ matrix[:3, :3].T).trace()) - 1) / 2
    assert math.degrees(math.acos(cosine)) < 2.5
    assert float((result[:3, 3] - matrix[:3, 3]).norm()) < 0.08
