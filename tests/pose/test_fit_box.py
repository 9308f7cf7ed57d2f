"""The circle of azimuths, and poses whose projection has the box's area and middle, whatever side it shows."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.pose.model import azimuth_distance, azimuth_sweep, fit_to_box, hull, level_poses, local_maxima
from nablahog.render import Camera, Mesh
from nablahog.render.camera import to_camera, to_screen

from ..chairs import chair
from .quadratics import START

CAMERA = Camera(400.0, 128, 160)


def around(points: Tensor, poses: Tensor) -> tuple[Tensor, Tensor]:
    """The corners (B, 2) of the boxes around the points' projections."""
    screen = to_screen(to_camera(points, poses), poses, CAMERA)[..., :2]
    return screen.amin(1), screen.amax(1)


def views() -> Tensor:
    azimuths = torch.arange(0.0, 360, 40, dtype=torch.float64)
    poses = torch.tensor([0.0, 25, 3, 0, 0, 0], dtype=torch.float64).repeat(len(azimuths), 1)
    poses[:, 0] = azimuths
    poses[:, 3] = torch.linspace(-10, 10, len(azimuths))
    poses[:, 4:] = torch.rand(len(azimuths), 2, dtype=torch.float64) * 20
    return poses


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return chair(2)


def test_the_hull_decides_the_box(mesh: Mesh) -> None:
    points, poses = hull(mesh), views()
    assert len(points) < len(mesh.vertices) / 2
    for few, all_of_them in zip(around(points, poses), around(mesh.vertices, poses), strict=True):
        assert_close(few, all_of_them)


@pytest.mark.parametrize("size", [(112.0, 60.0), (30.0, 80.0), (10.0, 10.0)])
def test_area_and_middle_are_those_of_the_box(mesh: Mesh, size: tuple[float, float]) -> None:
    poses = views()
    before = poses.clone()
    placed = fit_to_box(poses, hull(mesh), CAMERA, size)
    assert torch.equal(poses, before)
    assert torch.equal(placed[:, [0, 1, 3]], before[:, [0, 1, 3]])
    low, high = around(mesh.vertices, placed)
    assert_close((high - low).prod(1), torch.full_like(low[:, 0], size[0] * size[1]), rtol=0.005, atol=0)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double(), rtol=0, atol=1e-3)


def test_the_longer_side_is_the_one_given(mesh: Mesh) -> None:
    poses = fit_to_box(level_poses(torch.arange(0.0, 360, 40), 25), hull(mesh), CAMERA, 90.0)
    low, high = around(mesh.vertices, poses)
    assert_close((high - low).amax(1), torch.full_like(low[:, 0], 90), rtol=0.005, atol=0)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double(), rtol=0, atol=1e-3)


def test_it_comes_no_closer_than_a_diagonal(mesh: Mesh) -> None:
    placed = fit_to_box(views(), hull(mesh), CAMERA, (2000.0, 2000.0))
    assert (placed[:, 2] == 1).all()
    low, high = around(mesh.vertices, placed)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double())


@pytest.mark.parametrize("corners", [3, 4])
def test_of_flat_meshes_all_corners_count(corners: int) -> None:
    vertices = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1]], dtype=torch.float64)[:corners]
    flat = Mesh(vertices, torch.tensor([[0, 1, 2]]), torch.ones(corners, dtype=torch.float64)).normalized()
    half = 0.5**1.5
    assert_close(hull(flat), torch.tensor([[-half, 0, -half], [-half, 0, half], [half, 0, -half]]).double())
    edge_on = torch.tensor([[90.0, 0, 3, 0, 0, 0]], dtype=torch.float64)
    assert torch.isfinite(fit_to_box(edge_on, hull(flat), CAMERA, (100.0, 50.0))).all()


def test_distances_go_round() -> None:
    assert azimuth_distance(350, 20) == azimuth_distance(20, 350) == azimuth_distance(380, -10) == 30
    assert azimuth_distance(0, 180) == 180


def test_azimuth_sweep() -> None:
    poses = azimuth_sweep(START, 4)
    assert poses[:, 0].tolist() == [100, 190, 280, 370]
    assert (poses[:, 1:] == START[1:]).all()
    assert START[0] == 100


@pytest.mark.parametrize(
    ("values", "count", "expected"),
    [
        ([1, 5, 2, 3, 9, 0, 4, 3], 9, [4, 1, 6]),
        ([1, 5, 2, 3, 9, 0, 4, 3], 2, [4, 1]),
        ([9, 5, 2, 3, 1, 8], 3, [0, 3]),  # the last is beside the first
        ([0, 1, 2, 3], 3, [3]),
        ([4], 3, [0]),
    ],
)
def test_local_maxima(values: list[float], count: int, expected: list[int]) -> None:
    assert local_maxima(torch.tensor(values).double(), count).tolist() == expected
