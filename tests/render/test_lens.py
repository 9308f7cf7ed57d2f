"""Cameras with distortion and two focal lengths, beside OpenCV's."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch.testing import assert_close

from nablahog.inputs.boxes import Box
from nablahog.inputs.cameras import PhotographCamera, as_camera
from nablahog.io.images import sample_photograph
from nablahog.render.lens import STRIP_PIXELS, IdealCamera, distort, undistort

HEIGHT, WIDTH = 480, 640
NO_MOTION = np.zeros(3)
CAMERAS = {
    "barrel": ((520, 470, 335, 228), (-0.3, 0.1, 0.002, -0.001, -0.01)),
    "pincushion": ((600, 600, 310, 250), (0.2, 0.05, -0.001, 0.002, 0.0)),
    "square pixels": ((500, 500, 320, 240), (-0.25, 0.08, 0.0, 0.0)),
    "two focal lengths": ((500, 610, 300, 260), None),
}


def camera(name: str) -> PhotographCamera:
    intrinsics, distortion = CAMERAS[name]
    made = as_camera(HEIGHT, WIDTH, intrinsics=intrinsics, distortion=distortion)
    assert made is not None
    return made


def opencv(real: PhotographCamera) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    return np.array(real.matrix), np.array(real.distortion)


@pytest.mark.parametrize("name", CAMERAS)
def test_points_are_those_of_opencv(name: str) -> None:
    """Both ways, to 1e-6 of a pixel, in all of the photograph."""
    real, ideal = camera(name), IdealCamera(camera(name))
    photographed = np.random.default_rng(0).uniform((0, 0), (WIDTH, HEIGHT), (2000, 2))
    found = torch.stack(ideal.from_photograph(*torch.from_numpy(photographed.T)), dim=1)
    steps = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    matrix = np.array([[ideal.focal, 0, ideal.axis[0]], [0, ideal.focal, ideal.axis[1]], [0, 0, 1]])
    expected = cv2.undistortPointsIter(photographed[:, None], *opencv(real), None, matrix, steps)[:, 0]
    assert np.abs(found.numpy() - expected).max() < 1e-6

    rays = np.column_stack([(expected - matrix[:2, 2]) / ideal.focal, np.ones(len(expected))])
    projected = cv2.projectPoints(rays, NO_MOTION, NO_MOTION, *opencv(real))[0][:, 0]
    seen = torch.stack(ideal.to_photograph(*torch.from_numpy(expected.T)), dim=1)
    assert np.abs(seen.numpy() - projected).max() < 1e-6


@pytest.mark.parametrize("distortion", [(1.0, 0, 0, 0, 0), (0, 5.0, 0, 0, 0)])
def test_strong_distortion_is_undone(distortion: tuple[float, ...]) -> None:
    x, y = torch.meshgrid(*2 * [torch.linspace(-1, 1, 21, dtype=torch.float64)], indexing="xy")
    for found, expected in zip(undistort(*distort(x, y, distortion), distortion), (x, y), strict=True):
        assert_close(found, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("as_bytes", [False, True])
def test_a_photograph_is_that_of_opencv(as_bytes: bool) -> None:
    """OpenCV counts from the middle of the first pixel, and reads at multiples of 1/32 of a pixel."""
    photo = sample_photograph("coffee")
    height, width = photo.shape[1:]
    real = as_camera(height, width, intrinsics=(450, 450, 290, 205), distortion=(-0.2, 0.05, 0.001, 0.0005))
    assert real is not None
    matrix, distortion = opencv(real)
    matrix[:2, 2] -= 0.5
    maps = cv2.initUndistortRectifyMap(matrix, distortion, None, matrix, (width, height), cv2.CV_32FC1)
    expected = cv2.remap(photo.permute(1, 2, 0).numpy(), *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    asked = (photo * 255).round().byte() if as_bytes else photo
    found = IdealCamera(real).resample(asked, Box(0, 0, width, height))
    assert (found.dtype, found.shape) == (torch.float32, photo.shape)
    off = np.abs(found.permute(1, 2, 0).numpy() - expected)
    assert off.mean() < 0.002


def test_all_of_the_photograph_is_in_the_whole_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a lens that makes a barrel, the corners are far outside of the ideal camera's own picture."""
    ideal = IdealCamera(camera("barrel"))
    whole = ideal.whole
    assert max(whole.x0, whole.y0, ideal.width - whole.x1, ideal.height - whole.y1) < -40
    photo = torch.zeros(1, HEIGHT, WIDTH)
    photo[:, :24, :24] = 1.0  # a corner
    seen = ideal.resample(photo, ideal.whole)
    x, y = map(float, ideal.from_photograph(torch.tensor(12.0, dtype=torch.float64), torch.tensor(12.0)))
    assert seen[0, round(y - ideal.whole.y0), round(x - ideal.whole.x0)] > 0.99
    assert seen[0, HEIGHT // 2].max() < 0.01
    monkeypatch.setattr("nablahog.render.lens.STRIP_PIXELS", STRIP_PIXELS // 64)  # strips do not show
    torch.testing.assert_close(ideal.resample(photo, ideal.whole), seen)


@pytest.mark.parametrize("name", CAMERAS)
def test_boxes_come_back(name: str) -> None:
    ideal, box = IdealCamera(camera(name)), Box(100.0, 90.0, 300.0, 400.0)
    there = ideal.map_box(box)
    np.testing.assert_allclose(ideal.map_box_back(there), box, atol=3)
    assert max(abs(one - other) for one, other in zip(there, box, strict=True)) > 3


@pytest.mark.parametrize("distortion", [(-1.5, 0, 0, 0), (0, -3, 0, 0), (0.1, 0, 0.9, 0)])
def test_a_distortion_that_folds_is_refused(distortion: tuple[float, ...]) -> None:
    real = as_camera(HEIGHT, WIDTH, intrinsics=(500, 500, 320, 240), distortion=distortion)
    assert real is not None
    with pytest.raises(ValueError, match="can be undone"):
        IdealCamera(real)
