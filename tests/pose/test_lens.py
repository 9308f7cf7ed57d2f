"""Poses in photographs of cameras with distortion and two focal lengths."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

import nablahog
from nablahog import PoseEstimate, estimate_pose, render
from nablahog.inputs.boxes import Box
from nablahog.inputs.cameras import as_intrinsics
from nablahog.pose.result import DOUBT, warning
from nablahog.render import pose, silhouette
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.conventions import move_before_camera, pose_matrix

from .common import box_around, errors, model

HEIGHT, WIDTH = 480, 640
K = np.array([[520.0, 0, 335], [0, 470, 228], [0, 0, 1]])
DISTORTION = np.array([-0.3, 0.1, 0.002, -0.001, 0.0])
IDEAL = np.array([[500.0, 0, 500], [0, 500, 400], [0, 0, 1]])  # of the rendering, of 800x1000 pixels
EXACT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)


def distort(image: Tensor) -> Tensor:
    """A rendering by the ideal camera as the lens shows it, by OpenCV."""
    middles = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), -1).reshape(-1, 1, 2)
    places = cv2.undistortPointsIter(middles, K, DISTORTION, None, IDEAL, EXACT).reshape(HEIGHT, WIDTH, 2) - 0.5
    across, down = np.moveaxis(places.astype(np.float32), 2, 0)
    seen = cv2.remap(image.numpy(), across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return torch.from_numpy(seen)[None].clamp(0, 1)


def photographed(azimuth: float, elevation: float, place: tuple[float, float, float]) -> tuple[Tensor, Tensor, Box]:
    """A chair far from the axis: the photograph, the matrix (4, 4) of the chair in the camera's frame, and its box."""
    matrix = pose_matrix(pose(azimuth, elevation, 2.6)[0])
    matrix[:3, 3] = torch.tensor(place, dtype=torch.float64)
    scene = move_before_camera(model(), matrix, torch.from_numpy(IDEAL), 800, 1000)
    return distort(render(*scene)[0, 0]), matrix, box_around(distort(silhouette(*scene)[0, 0])[0] > 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("azimuth", "elevation", "place"), [(35, 18, (1.0, -0.35, 2.6)), (130, 12, (-1.3, 0.3, 2.8))])
def test_the_pose_is_found_again(azimuth: float, elevation: float, place: tuple[float, float, float]) -> None:
    photo, matrix, box = photographed(azimuth, elevation, place)
    estimate = estimate_pose(photo, model(), box=box, intrinsics=K, distortion=DISTORTION)
    degrees, off = errors(estimate, matrix)
    assert degrees < 1
    assert off < 0.05
    assert estimate.box == box
    degrees, off = errors(estimate_pose(photo, model(), box=box, intrinsics=K), matrix)
    assert off > 0.2  # the lens alone: the test can fail


@pytest.mark.slow
def test_without_a_box_it_is_found_in_pixels_of_the_photograph() -> None:
    photo, matrix, box = photographed(130, 12, (-1.3, 0.3, 2.8))
    estimate = estimate_pose(photo, model(), intrinsics=K, distortion=DISTORTION)
    assert errors(estimate, matrix)[0] < 1
    assert np.abs(np.subtract(estimate.box, box)).max() < 8
    assert estimate.runners_up
    assert all(rival.photograph_camera == estimate.photograph_camera for rival in estimate.runners_up)


@pytest.fixture(scope="module")
def estimate() -> tuple[PoseEstimate, Tensor, Box]:
    photo, _, box = photographed(35, 18, (1.0, -0.35, 2.6))
    return estimate_pose(photo, model(), box=box, intrinsics=K, distortion=DISTORTION), photo, box


def test_vertices_are_where_opencv_projects_them(estimate: tuple[PoseEstimate, Tensor, Box]) -> None:
    """The outline's on the undistorted photograph, and by the camera's own numbers on the photograph itself."""
    found, photo, _ = estimate
    mesh = model()
    points = (torch.linalg.inv(mesh.from_original) @ torch.nn.functional.pad(mesh.vertices, (0, 1), value=1).T).T
    turn, move = cv2.Rodrigues(found.matrix().numpy()[:3, :3])[0], found.matrix().numpy()[:3, 3]
    expected = cv2.projectPoints(points[:, :3].numpy(), turn, move, found.intrinsics.numpy(), None)[0][:, 0]
    drawn, poses, camera = found.render_arguments(mesh)
    own = to_screen(to_camera(drawn.vertices, poses), poses, camera)[0, :, :2]
    assert np.abs(own.numpy() - expected).max() < 1e-6

    undistorted = found.undistort(photo)
    assert undistorted.shape[1:] == (camera.height, camera.width) == (round(HEIGHT * 520 / 470), WIDTH)
    white = silhouette(drawn, poses, camera)[0, 0] > 0.5
    assert float(((undistorted[0] < 0.99) & white).sum() / ((undistorted[0] < 0.99) | white).sum()) > 0.9
    seen = cv2.projectPoints(points[:, :3].numpy(), turn, move, K, DISTORTION)[0][:, 0]
    assert np.abs(np.concatenate([seen.min(0), seen.max(0)]) - np.array(found.box)).max() < 5


def test_what_is_written_says_so(estimate: tuple[PoseEstimate, Tensor, Box], tmp_path: Path) -> None:
    found, photo, box = estimate
    assert found.share == 1
    found.save(tmp_path / "pose.json")
    written = json.loads((tmp_path / "pose.json").read_text())
    assert written["photograph_camera"] == {
        "camera_matrix": K.tolist(),
        "dist_coeffs": DISTORTION.tolist(),
        "image_size": [HEIGHT, WIDTH],
    }
    assert written["box"] == list(box)
    assert written["intrinsics"] == found.intrinsics.tolist()
    with pytest.raises(ValueError, match="of 480x640 pixels, got 100x100"):
        found.undistort(photo[:, :100, :100])


def test_an_ideal_camera_changes_nothing() -> None:
    """The lens of no distortion and one focal length, by all ways to write it."""
    photo, _, box = photographed(35, 18, (1.0, -0.35, 2.6))
    options: dict[str, Any] = {"box": box, "initial": (35, 18), "method": "exhaustive"}
    plain = estimate_pose(photo, model(), focal=500, principal_point=(320, 250), **options)
    other = estimate_pose(photo, model(), intrinsics=(500, 500, 320, 250), distortion=(0, 0, 0, 0), **options)
    assert torch.equal(plain.pose, other.pose)
    assert other.photograph_camera is None
    assert torch.equal(other.undistort(photo), photo)
    bytes_of_photo = (255 * photo).round().byte()
    assert torch.equal(other.undistort(bytes_of_photo), bytes_of_photo / 255)


def test_a_mask_belongs_to_the_photograph() -> None:
    photo, matrix, box = photographed(130, 12, (-1.3, 0.3, 2.8))
    mask = photo[0] < 0.99
    estimate = estimate_pose(photo, model(), mask=mask, intrinsics=K, distortion=DISTORTION)
    assert errors(estimate, matrix)[0] < 1
    assert np.abs(np.subtract(estimate.box, box)).max() < 3


def test_a_single_model_has_the_name_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "my chair.off").write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 0 1\n0 1 0\n3 0 1 2\n3 0 2 3\n")
    mesh = nablahog.load_mesh(tmp_path / "my chair.off")
    options: dict[str, Any] = {"method": "exhaustive", "initial": (0, 0)}
    found = estimate_pose(torch.rand(1, 64, 64, generator=torch.Generator().manual_seed(0)), mesh, **options)
    found.save(tmp_path / "pose.json")
    assert json.loads((tmp_path / "pose.json").read_text())["model"] == found.model == "my chair"


def test_the_error_of_a_flat_camera_matrix_says_how_to_shape_it() -> None:
    with pytest.raises(ValueError, match="reshape"):
        as_intrinsics("intrinsics", (700, 0, 320, 0, 700, 240, 0, 0, 1))


CAMERA_FILE = "1 OPENCV {} {} 520 470 335 228 -0.3 0.1 0.002 -0.001\n"


def test_a_camera_file_is_read_with_its_distortion(estimate: tuple[PoseEstimate, Tensor, Box], tmp_path: Path) -> None:
    found, photo, box = estimate
    cameras = tmp_path / "cameras.txt"
    cameras.write_text(CAMERA_FILE.format(WIDTH, HEIGHT))
    assert torch.equal(estimate_pose(photo, model(), box=box, intrinsics=cameras).pose, found.pose)
    with pytest.raises(ValueError, match="expected no `distortion`"):
        estimate_pose(photo, model(), intrinsics=str(cameras), distortion=DISTORTION)


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ((1280, 960), "write `intrinsics`=260,235,167.5,114 and `distortion`=-0.3,0.1,0.002,-0.001,0"),
        ((1280, 963), "write `intrinsics`=260,234.268,167.5,113.645 and"),
        ((480, 640), "turn the photograph"),
        ((240, 320), "turn it as it was taken"),
        ((900, 640), "subtracted from cx"),
    ],
)
def test_the_file_of_another_size_is_refused(size: tuple[int, int], said: str, tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(CAMERA_FILE.format(*size))
    photo = torch.zeros(1, HEIGHT, WIDTH)
    with pytest.raises(ValueError, match=r"is for photographs of .* got 480x640") as caught:
        estimate_pose(photo, model(), intrinsics=tmp_path / "cameras.txt")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("across", "down", "warns"),
    [
        (0.5, 0.5, True),
        (1.02, 1.02, False),
        (2, 2, True),
        (3, 3, True),
        (0.35, 0.6, True),
        (1.55, 0.45, False),
        (3, 2.2, True),
    ],
)
def test_a_principal_point_of_another_size_brings_a_warning(across: float, down: float, warns: bool) -> None:
    photo = torch.rand(1, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0))
    camera = [across * 520, across * 520, across * 322, down * 238]
    options: dict[str, Any] = {"box": (200, 150, 400, 350), "initial": (0, 0), "method": "exhaustive"}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = estimate_pose(photo, model(), intrinsics=camera, **options)
    advice = [str(each.message) for each in caught]
    assert all(each.filename == __file__ for each in caught)
    doubt = [f"the similarity, {found.similarity:.1f}, is no higher than in photographs without the object: {DOUBT}"]
    assert warning(found) == "; ".join(advice + doubt)
    assert ["outside" in text for text in advice] == [down == 2.2] * warns
