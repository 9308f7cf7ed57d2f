"""The result of a search as a matrix and in the model's units, and penalties for what photographs seldom show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.testing import assert_close

from nablahog.inputs.boxes import Box
from nablahog.inputs.cameras import as_view
from nablahog.pose import PoseEstimate, search_steps
from nablahog.pose.best_search import BestSearch
from nablahog.pose.crop import crop_object
from nablahog.pose.model import equidistant_azimuths, prepared_model
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.problem import (
    SMALL_PENALTY,
    STEEP_PENALTY,
    TILT_PENALTY,
    PoseProblem,
    allowed_azimuths,
    elevations_around,
    view_penalty,
)
from nablahog.pose.result import pose_figures
from nablahog.pose.similarity import Similarity
from nablahog.render import Camera, Mesh, load_mesh, pose, render
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.conventions import move_before_camera, pose_matrix

from ..render.shapes import by_opencv
from .common import box_around, model

CAMERA = Camera(250.0, 120, 160)
TETRAHEDRON = np.array([[10.0, 20, 30], [310, 20, 30], [10, 420, 30], [10, 20, 1230]])  # millimetres


@pytest.fixture
def mesh(tmp_path: Path) -> Mesh:
    """Of a file with y up, so that it is turned, moved and scaled when it is read."""
    lines = ["v " + " ".join(map(str, corner)) for corner in TETRAHEDRON]
    path = tmp_path / "mesh.obj"
    path.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4", "f 1 2 4", "f 2 3 4", ""]))
    return load_mesh(path)


def estimate(mesh: Mesh, axis: tuple[float, float] | None = None) -> PoseEstimate:
    one = PoseEstimate(30, 10, 2.5, 4, 31, -22.5, CAMERA, "", 9.0, "calibrated", torch.zeros(6), 100, Box(0, 0, 9, 9))
    return replace(one, principal_point=axis, from_original=mesh.from_original)


@pytest.mark.parametrize("axis", [None, (75.0, 61.0)])
def test_the_matrix_maps_points_of_the_file_to_where_they_are_drawn(
    mesh: Mesh, axis: tuple[float, float] | None
) -> None:
    one = estimate(mesh, axis)
    turned = torch.from_numpy(TETRAHEDRON[:, [0, 2, 1]] * [1, -1, 1])  # y up, front to +z
    normalised = (turned - (turned.amax(0) + turned.amin(0)) / 2) / 1300
    points = torch.from_numpy(TETRAHEDRON)[torch.cdist(mesh.vertices, normalised).argmin(1)]  # in the mesh's order
    assert_close(points @ mesh.from_original[:3, :3].T + mesh.from_original[:3, 3], mesh.vertices)
    moved, poses, camera = one.render_arguments(mesh)
    drawn = to_screen(to_camera(moved.vertices, poses), poses, camera)[0, :, :2]
    assert_close(by_opencv(points, one.matrix(), one.intrinsics), drawn, rtol=0, atol=1e-9)
    assert (moved is mesh) == (axis is None)


@pytest.mark.parametrize(
    ("azimuth", "within", "searched"),
    [(0.0, 15.0, [0, 7.5, 15, 345, 352.5]), (352.5, 7.5, [0, 345, 352.5]), (5.0, 1.0, [7.5])],
)
def test_views_up_to_the_bound_are_searched_and_the_nearest_in_any_case(
    azimuth: float, within: float, searched: list[float]
) -> None:
    around = equidistant_azimuths(48)
    assert around[allowed_azimuths(around, (azimuth, 0.0), within)].tolist() == searched


def test_no_view_is_searched_beyond_a_pole() -> None:
    assert elevations_around((0.0, 75.0)) == (60, 75, 90)
    assert elevations_around((0.0, -80.0)) == (-80, -65)


@pytest.mark.parametrize("axis", [None, (75.0, 61.0)])
def test_it_is_rigid_and_in_the_files_units(mesh: Mesh, axis: tuple[float, float] | None) -> None:
    matrix = estimate(mesh, axis).matrix()
    assert_close(matrix[:3, :3] @ matrix[:3, :3].T, torch.eye(3, dtype=torch.float64))
    assert_close(matrix[3], matrix.new_tensor([0, 0, 0, 1]))
    middle = torch.tensor([160.0, 220, 630], dtype=torch.float64)  # of its bounding box, of diagonal 1300
    assert float((matrix[:3, :3] @ middle + matrix[:3, 3]).norm()) == pytest.approx(2.5 * 1300)
    assert estimate(mesh).distance_in_file_units == pytest.approx(2.5 * 1300)
    assert mesh.unit == pytest.approx(1300)


def test_opengls_frame_is_opencvs_turned_about_x(mesh: Mesh) -> None:
    one = estimate(mesh, (75, 61))
    half_a_turn = torch.diag(torch.tensor([1.0, -1, -1, 1], dtype=torch.float64))
    assert_close(one.matrix("opengl"), half_a_turn @ one.matrix("opencv"))
    with pytest.raises(ValueError, match="convention must be one of 'opencv', 'opengl'"):
        one.matrix("directx")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(120, 160), (160, 120)])
@pytest.mark.parametrize("axis", [None, (75.0, 61.0)])
def test_blenders_camera_sees_the_model_where_it_is_drawn(
    mesh: Mesh, axis: tuple[float, float] | None, size: tuple[int, int]
) -> None:
    """By the formulas of docs/poses.md: lens · x / -z on the sensor, shifted by parts of its longer side."""
    one = replace(estimate(mesh, axis), camera=Camera(250.0, *size))
    imported = torch.from_numpy(TETRAHEDRON[:, [0, 2, 1]] * [1, -1, 1])  # as its importer turns files with y up
    (height, width), longer, sensor = size, max(size), 36.0
    (focal, _, x), (_, _, y), _ = one.intrinsics.tolist()
    turn, place = one.camera_to_world[:3, :3], one.camera_to_world[:3, 3]
    seen = (imported - place) @ turn  # the inverse of a rigid motion
    lens, shift = focal * sensor / longer, seen.new_tensor([width / 2 - x, y - height / 2]) / longer
    plane = lens / sensor * seen[:, :2] / -seen[:, 2:] - shift  # in parts of the longer side, y up
    pixels = plane * torch.tensor([longer, -longer]) + torch.tensor([width / 2, height / 2])
    assert bool((seen[:, 2] < 0).all())
    assert_close(pixels, by_opencv(torch.from_numpy(TETRAHEDRON), one.matrix(), one.intrinsics), rtol=0, atol=1e-9)
    assert_close(turn @ turn.T, torch.eye(3, dtype=torch.float64))
    upright = replace(one, theta=0.0, elevation=0.0, principal_point=None).camera_to_world
    assert_close(upright[:3, 1], upright.new_tensor([0, 0, 1]))  # its y is the world's z


def test_an_estimate_is_saved_as_the_command_writes_it(mesh: Mesh, tmp_path: Path) -> None:
    one = estimate(mesh)
    one.save(tmp_path / "pose.json")
    stored = json.loads((tmp_path / "pose.json").read_text())
    assert stored == pose_figures(one)
    assert_close(torch.tensor(stored["matrix_world"], dtype=torch.float64), one.camera_to_world)


def test_the_intrinsics_are_those_of_the_camera(mesh: Mesh) -> None:
    assert estimate(mesh, (75, 61)).intrinsics.tolist() == [[250, 0, 75], [0, 250, 61], [0, 0, 1]]
    assert estimate(mesh).intrinsics.tolist() == [[250, 0, 80 + 31], [0, 250, 60 - 22.5], [0, 0, 1]]


def test_the_crop_of_a_known_camera_shows_the_object_as_it_is_rendered() -> None:
    """An object 23° beside the optical axis of a wide lens, by a rigid motion; its crop's pose is drawn straight."""
    matrix = pose_matrix(pose(35, 18, 2.6, 3)[0])
    matrix[:3, 3] += matrix.new_tensor([1.1, -0.35, 0])
    axis, focal = (325.0, 236.0), 420.0
    intrinsics = torch.tensor([[focal, 0, axis[0]], [0, focal, axis[1]], [0, 0, 1]], dtype=torch.float64)
    photograph = render(*move_before_camera(model(), matrix, intrinsics, 480, 640))[0]
    box = box_around(photograph[0] < 1)
    crop = crop_object(photograph, box, focal=focal, axis=axis)
    # what the camera sees that is turned to the object's origin
    turned = crop.turn @ matrix[:3, :3]
    place = crop.turn @ matrix[:3, 3]
    seen = torch.eye(4, dtype=torch.float64)
    seen[:3, :3], seen[:3, 3] = turned, place
    of_crop = torch.tensor([[crop.camera.focal, 0, 64], [0, crop.camera.focal, 64], [0, 0, 1]], dtype=torch.float64)
    expected = render(*move_before_camera(model(), seen, of_crop, 128, 128))[0]
    assert float((crop.image[0] - expected).abs().mean()) < 0.012
    assert max(crop.size) == pytest.approx(112)
    plain = crop_object(photograph, box, focal=focal)
    assert float((plain.image[0] - expected).abs().mean()) > 0.03


IMAGE = torch.rand(1, 120, 160, generator=torch.Generator().manual_seed(0))
BOX = (40.0, 20.0, 120.0, 100.0)  # half of the photograph's longer side


ANGLES = st.floats(-1000, 1000) | st.sampled_from([-1e-20, 90.0, -90.0, 180.0, 360.0])


def problem(*, boxes: bool = False, initial: tuple[float, float] | None = None) -> PoseProblem:
    return PoseProblem(
        IMAGE,
        PreparedPhotograph(crop_object(IMAGE, BOX)),
        Box(*BOX),
        () if boxes else None,
        {"": prepared_model(model())},
        initial,
    )


@given(azimuth=ANGLES, elevation=ANGLES, theta=ANGLES)
def test_every_estimate_is_in_the_ranges_of_the_conventions(azimuth: float, elevation: float, theta: float) -> None:
    """Whatever a search has come to, it is the same rotation, and can be given as the initial pose again."""
    found = pose(azimuth, elevation, 3, theta)[0]
    one = problem().estimate("", found, similarity=9.0, renderings=1)
    for angles in (one.pose[0], one.crop_pose):
        assert 0 <= angles[0] < 360
        assert abs(angles[3]) <= 180
        assert as_view("initial", angles[:2]) == tuple(angles[:2].tolist())
        assert_close(pose_matrix(angles), pose_matrix(found), rtol=0, atol=1e-9)


def test_a_search_that_is_bounded_does_not_pass_over_a_pole() -> None:
    bounded = replace(problem(initial=(20.0, 80.0)), within=10.0)
    assert bounded.limit_azimuths(pose(45, 97)).tolist() == pose(30, 90).tolist()


def test_steep_and_tilted_views_have_a_penalty_usual_ones_none() -> None:
    penalties = view_penalty(torch.tensor([0.0, 40, 60, -15]), torch.tensor([0.0, 0, 10, 0]))
    assert penalties.tolist() == pytest.approx([0, 0, 20 * STEEP_PENALTY + 10 * TILT_PENALTY, 5 * STEEP_PENALTY])


@pytest.mark.parametrize("elevation", [60.0, 85, 89.5, 90, -86])
@pytest.mark.parametrize("tilt", [0.0, 20, -150, 180])
def test_the_penalty_of_a_rotation_does_not_depend_on_how_it_is_written(elevation: float, tilt: float) -> None:
    over_the_pole = 180.0 - elevation, tilt + 180
    one, other = view_penalty(*torch.tensor([(elevation, tilt), over_the_pole]).double().T).tolist()
    assert one == pytest.approx(other, abs=1e-9)
    if elevation == 90:  # there a turn of azimuth is one in the image plane
        assert one == pytest.approx(float(view_penalty(torch.tensor([90.0]), torch.zeros(1))))


def test_an_elevation_that_is_given_is_a_wish() -> None:
    poses = torch.tensor([[0.0, 80, 3, 30, 0, 0]], dtype=torch.float64)
    given, off, unknown = problem(initial=(0.0, 80.0)), problem(initial=(0.0, 65.0)), problem()
    assert float(given.penalty(poses, given.photograph)) == pytest.approx(30 * TILT_PENALTY)
    assert float(off.penalty(poses, off.photograph)) == pytest.approx(10 * STEEP_PENALTY + 30 * TILT_PENALTY)
    assert float(unknown.penalty(poses, unknown.photograph)) == pytest.approx(40 * STEEP_PENALTY + 30 * TILT_PENALTY)
    assert off.elevations == (50.0, 65.0, 80.0)
    assert problem(initial=(0.0, 80.0)).elevations == (65.0, 80.0)


def test_an_object_anywhere_loses_with_each_halving_of_its_size() -> None:
    anywhere = problem(boxes=True, initial=(0.0, 10.0))
    level = torch.tensor([[0.0, 10, 3, 0, 0, 0]], dtype=torch.float64)
    assert float(anywhere.penalty(level, anywhere.photograph)) == pytest.approx(SMALL_PENALTY)
    assert float(anywhere.penalty(level, anywhere.crop_around((0, 0, 160, 120)))) == pytest.approx(0, abs=1e-9)


def test_no_view_loses_by_climbing() -> None:
    search = BestSearch(problem(initial=(0.0, 10.0)))
    views = search.find_level_views()
    best = views[0].move(views[0].pose, 99.0, 99.0)
    climbed = search.climb([best, *views])
    assert climbed[0] is best
    assert all(after.score >= before.score for after, before in zip(climbed[1:], views, strict=True))
    assert climbed[1:] != views


def test_there_may_be_no_views_elsewhere() -> None:
    search = BestSearch(problem(initial=(0.0, 10.0)))
    assert search.climb([]) == search.tilt([]) == []


def test_of_equally_similar_views_those_without_a_penalty_are_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search_steps, "view_descriptors", lambda *_: torch.zeros(48, 9, 16, 16))
    monkeypatch.setattr(Similarity, "values", lambda self, poses: torch.zeros(len(poses), dtype=torch.float64))
    search = BestSearch(problem())
    views = search.find_level_views()
    tilted = search.tilt(views)
    assert len(tilted) == len(views) > 0
    assert {float(view.pose[1]) for view in views} <= {0.0, 15.0, 30.0}
    assert all(view.pose[3] == 0 for view in tilted)


@pytest.mark.parametrize(
    ("confidence", "similarity", "doubtful"),
    [(0.8, 4.0, False), (0.3, 12.0, True), (None, 4.0, True), (None, 6.0, False)],
)
def test_the_confidence_says_whether_a_pose_is_doubtful_the_similarity_only_without_it(
    mesh: Mesh, confidence: float | None, similarity: float, doubtful: bool
) -> None:
    one = replace(estimate(mesh), confidence=confidence, similarity=similarity)
    assert (pose_figures(one)["warning"] is not None) == doubtful
