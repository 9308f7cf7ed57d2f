"""The near plane: what is in front stays as it is, what is behind goes, and nothing opens between."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, gbuffer, pipeline, pose, render
from nablahog.render.pipeline import clip
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
        cut = clip(side, faces, corners, near)
        assert (cut.points[cut.faces][..., 2] >= near).all()
        assert cut.brightness.shape == cut.faces.shape
        total += area(cut.points, cut.faces)
    assert total == pytest.approx(area(points, faces), rel=1e-9)


@given(st.integers(0, 1000))
def test_cut_triangles_stay_in_their_plane_with_their_brightness_and_winding(seed: int) -> None:
    """Brightness that is linear in space stays so."""
    points, faces, _ = soup(seed, 1)
    slope = torch.tensor([0.3, -0.7, 0.2], dtype=torch.float64)
    cut = clip(points, faces, points[faces] @ slope, NEAR)
    assert_close(cut.brightness, cut.points[cut.faces] @ slope)
    a, b, c = points[faces[0]]
    normal = torch.linalg.cross(b - a, c - a)
    assert_close((cut.points[cut.faces] - a) @ normal, torch.zeros(len(cut.faces), 3, dtype=torch.float64))
    p, q, r = cut.points[cut.faces].unbind(1)
    assert (torch.linalg.cross(q - p, r - p) @ normal > 0).all()


def test_what_is_in_front_is_left_alone() -> None:
    points, faces, corners = soup(0)
    cut = clip(points, faces, corners, -10.0)
    assert torch.equal(cut.points, points)
    assert torch.equal(cut.faces, faces)
    assert torch.equal(cut.brightness, corners)


def test_nothing_in_front() -> None:
    cut = clip(*soup(0), 10.0)
    assert cut.faces.shape == (0, 3)
    assert cut.brightness.shape == (0, 3)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_two_triangles_cut_their_common_edge_in_the_same_point(dtype: torch.dtype) -> None:
    """Bit for bit, whichever of its ends comes first in either."""
    whole = box()
    points = whole.vertices + torch.rand(8, 3, dtype=torch.float64) * 0.3 + torch.tensor([0, 0, 0.2])
    faces = torch.where(torch.rand(12, 1) < 0.5, whole.faces, whole.faces.flip(1)).roll(1, 1)
    cut = clip(points.to(dtype), faces, torch.ones(12, 3, dtype=dtype), NEAR)
    new = cut.points[8:].tolist()
    assert len(new) > 8
    assert set(Counter(map(tuple, new)).values()) == {2}


def test_derivatives() -> None:
    points, faces, corners = soup(3, 4)

    def cut(points: Tensor, corners: Tensor) -> tuple[Tensor, Tensor]:
        result = clip(points, faces, corners, NEAR)
        return result.points, result.brightness

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


def test_poses_of_a_batch_are_cut_each_in_its_own_way() -> None:
    where = torch.cat([pose(20, 10, 3), pose(20, 10, 0.6), pose(0, 0, 0.5), pose(200, -30, 0.1)])
    picture = torch.rand(4, 1, 30, 40)
    for background in (picture, picture.double(), 0.3):
        renderer = Renderer(box(), WIDE)
        images = renderer(where, background)
        for k in range(4):
            one = background[k : k + 1] if isinstance(background, Tensor) else background
            assert torch.equal(images[k : k + 1], renderer(where[k : k + 1], one))


@pytest.mark.parametrize("method", ["edges", "opendr"])
def test_views_that_are_not_cut_are_drawn_together(method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a device, where PyTorch draws: what is visible is found once for these, and once for each that is cut."""
    where = torch.cat([pose(20, 10, 3), pose(20, 10, 0.6), pose(70, 20, 4), pose(0, 0, 0.5), pose(200, -30, 5, 20)])
    background = torch.rand(5, 1, 30, 40, dtype=torch.float64)
    weights = torch.rand(5, 1, 30, 40, dtype=torch.float64)
    renderer = Renderer(box(), WIDE, method=method)
    alone = [render_with_gradient(renderer, where[k : k + 1], background[k : k + 1], weights[k]) for k in range(5)]
    drawn: list[int] = []
    own = pipeline.rasterize

    def counted(screen: Tensor, *rest: Any) -> tuple[Tensor, Tensor]:
        drawn.append(len(screen))
        return own(screen, *rest)

    monkeypatch.setattr(pipeline, "rasterize", counted)
    images, grad_poses = render_with_gradient(renderer, where, background, weights)
    assert drawn == [3, 1, 1]
    assert_close(images, torch.cat([each[0] for each in alone]), atol=1e-12, rtol=0)
    assert_close(grad_poses, torch.cat([each[1] for each in alone]), atol=1e-9, rtol=1e-9)


def render_with_gradient(
    renderer: Renderer, where: Tensor, background: Tensor, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Images, and the gradient with respect to the poses from one of the images."""
    where = where.clone().requires_grad_()
    images = renderer(where, background)
    (grad_poses,) = torch.autograd.grad(images, where, weights.expand_as(images))
    return images.detach(), grad_poses


def test_depths_and_normals_of_a_batch_are_those_of_each_view(monkeypatch: pytest.MonkeyPatch) -> None:
    where = torch.cat([pose(20, 10, 3), pose(20, 10, 0.6), pose(70, 20, 4), pose(0, 0, 0.5), pose(200, -30, 5, 20)])
    alone = [depth_and_normals(box(), one, WIDE) for one in torch.split(where, 1)]
    drawn: list[int] = []
    own = gbuffer.rasterize

    def counted(screen: Tensor, *rest: Any) -> tuple[Tensor, Tensor]:
        drawn.append(len(screen))
        return own(screen, *rest)

    monkeypatch.setattr(gbuffer, "rasterize", counted)
    together = depth_and_normals(box(), where, WIDE)
    assert drawn == [3, 1, 1]
    for part, parts in zip(together, zip(*alone, strict=True), strict=True):
        assert_close(part, torch.cat(parts), atol=1e-12, rtol=1e-12)
