"""The near plane: what is in front stays as it is, what is behind goes, and nothing opens between."""

from __future__ import annotations

import math
from collections import Counter

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose, render
from nablahog.render.rasterize import clip
from nablahog.render.renderer import Method

from .shapes import FLAT, box, mesh, quads

WIDE = Camera.from_field_of_view(60, 30, 40)
NEAR = 0.25


def soup(seed: int, count: int = 30) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(6, 3, generator=generator, dtype=torch.float64)
    faces = torch.stack([torch.randperm(6, generator=generator)[:3] for _ in range(count)])
    return points, faces, torch.rand(count, 3, generator=generator, dtype=torch.float64)


def area(points: Tensor, faces: Tensor) -> float:
    a, b, c = points[faces].unbind(1)
    return float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)


@given(st.integers(0, 1000))
def test_both_sides_of_the_plane_together_are_all(seed: int) -> None:
    points, faces, corners = soup(seed)
    mirrored = points * torch.tensor([1.0, 1, -1])
    total = 0.0
    for side, near in ((points, NEAR), (mirrored, -NEAR)):
        cut_points, cut_faces, brightness = clip(side, faces, corners, near)
        assert (cut_points[cut_faces][..., 2] >= near).all()
        assert brightness.shape == cut_faces.shape
        total += area(cut_points, cut_faces)
    assert total == pytest.approx(area(points, faces), rel=1e-9)


@given(st.integers(0, 1000))
def test_cut_triangles_stay_in_their_plane_with_their_brightness_and_winding(seed: int) -> None:
    """Brightness that is linear in space stays so."""
    points, faces, _ = soup(seed, 1)
    slope = torch.tensor([0.3, -0.7, 0.2], dtype=torch.float64)
    cut_points, cut_faces, brightness = clip(points, faces, points[faces] @ slope, NEAR)
    corners = cut_points[cut_faces]
    assert_close(brightness, corners @ slope)
    a, b, c = points[faces[0]]
    normal = torch.linalg.cross(b - a, c - a)
    assert_close((corners - a) @ normal, torch.zeros(len(corners), 3, dtype=torch.float64))
    p, q, r = corners.unbind(1)
    assert (torch.linalg.cross(q - p, r - p) @ normal > 0).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_two_triangles_cut_their_common_edge_in_the_same_point(dtype: torch.dtype) -> None:
    """Bit for bit, whichever of its ends comes first in either."""
    whole = box()
    points = whole.vertices + torch.rand(8, 3, dtype=torch.float64) * 0.3 + torch.tensor([0, 0, 0.2])
    faces = torch.where(torch.rand(12, 1) < 0.5, whole.faces, whole.faces.flip(1)).roll(1, 1)
    new = clip(points.to(dtype), faces, torch.ones(12, 3, dtype=dtype), NEAR)[0][8:].tolist()
    assert len(new) > 8
    assert set(Counter(map(tuple, new)).values()) == {2}


def test_derivatives() -> None:
    points, faces, corners = soup(3, 4)

    def cut(points: Tensor, corners: Tensor) -> tuple[Tensor, Tensor]:
        front, _, brightness = clip(points, faces, corners, NEAR)
        return front, brightness

    inputs = points.requires_grad_(), corners.requires_grad_()
    assert torch.autograd.gradcheck(cut, inputs, check_forward_ad=True)


@pytest.mark.parametrize("distance", [0.01, 0.2, 0.4])
def test_from_inside_a_box_nothing_of_the_background_is_seen(distance: float) -> None:
    for where in (pose(0, 0, distance), pose(33, 20, distance), pose(120, -70, distance, 10)):
        for image in (
            render(box(), where, WIDE, background=1.0, light=FLAT),
            render(box(), where, WIDE, background=torch.ones(1, 1, 30, 40, dtype=torch.float64), light=FLAT),
        ):
            assert_close(image, torch.full_like(image, 0.8))


def ground(half: float, height: float) -> Mesh:
    corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
    return mesh(corners, quads([(0, 1, 2, 3)]))


def test_the_ground_goes_under_the_camera_and_on_behind_it() -> None:
    """Half of it is behind.  It fills all rows below where it ends, at 5 + 1 in front of the camera."""
    where = pose(0, 0, 1)
    end = 15 + WIDE.focal * 0.2 / 6
    for background in (1.0, torch.ones(1, 1, 30, 40, dtype=torch.float64)):
        image = render(ground(5, -0.2), where, WIDE, background=background, light=FLAT)
        below = math.ceil(end)
        assert_close(image[0, 0, below:, 5:35], torch.full((30 - below, 30), 0.8, dtype=image.dtype))
        assert_close(image[0, 0, : math.floor(end)], torch.ones(math.floor(end), 40, dtype=image.dtype))
    depth, normals = depth_and_normals(ground(5, -0.2), where, WIDE)
    rows = torch.arange(below, 30, dtype=torch.float64) + 0.5 - 15
    assert_close(depth[0, below:], (0.2 * WIDE.focal / rows)[:, None].expand(-1, 40))
    up = torch.tensor([0.0, -1, 0], dtype=torch.float64)[:, None, None]
    assert_close(normals[0, :, below:], up.expand(3, 30 - below, 40))


@pytest.mark.parametrize("method", ["edges", "opendr"])
def test_an_object_behind_the_camera_is_not_seen(method: Method) -> None:
    far = box()
    behind = Mesh(far.vertices + torch.tensor([0, -9.0, 0]), far.faces, far.brightness)
    picture = torch.rand(1, 1, 30, 40)
    for background in (picture, picture.double()):
        where = pose(0, 0, 3).requires_grad_()
        image = Renderer(behind, WIDE, method=method)(where, background)
        assert_close(image, background, rtol=0, atol=1e-6)
        assert torch.equal(torch.autograd.grad(image.sum(), where)[0], torch.zeros(1, 6, dtype=torch.float64))
    depth, normals = depth_and_normals(behind, pose(0, 0, 3), WIDE)
    assert torch.isinf(depth).all()
    assert not normals.any()
