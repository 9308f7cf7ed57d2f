"""What is seen at samples: the depth buffer against every triangle at every sample, and clipping at the near plane."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose, render
from nablahog.render.rasterize import clip, rasterize, rasterize_torch
from nablahog.render.renderer import EdgeMethod

from .shapes import FLAT, box, mesh, quads

Rasterizer = Callable[[Tensor, Tensor, int, int], tuple[Tensor, Tensor]]
HEIGHT, WIDTH = 23, 31
dtypes = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["float32", "float64"])
backends = pytest.mark.parametrize("find", [rasterize, rasterize_torch], ids=["native", "torch"])


def soup(seed: int, count: int = 40) -> tuple[Tensor, Tensor]:
    """Triangles all over the image and beyond, at any depth, some of them slivers: (B, V, 3) and faces."""
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(2, 3 * count, 3, generator=generator, dtype=torch.float64)
    points = points * torch.tensor([50.0, 40, 0.9]) + torch.tensor([-10.0, -8, 0.1])
    points[:, 2 : 3 * count // 2 : 3, :2] = points[:, : 3 * count // 2 : 3, :2] + 0.8
    return points, torch.arange(3 * count).reshape(count, 3)


def one_by_one(points: Tensor, faces: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The nearest triangle at each sample, 1 / depth, and whether it is beyond doubt: (H, W) each."""
    y, x = torch.meshgrid(*(torch.arange(n).double() + 0.5 for n in (HEIGHT, WIDTH)), indexing="ij")
    depths = torch.zeros(len(faces), HEIGHT, WIDTH, dtype=torch.float64)
    clear = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    for k, (a, b, c) in enumerate(points[faces].double()):
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((b, c), (c, a), (a, b))]
        area = sum(sides)
        weights = torch.stack([side / area for side in sides])
        inside = (weights >= 0).all(0)
        w = sum(weight * corner[2] for weight, corner in zip(weights, (a, b, c), strict=True))
        depths[k] = torch.where(inside, w, 0)
        lengths = torch.stack([(c - b)[:2].norm(), (a - c)[:2].norm(), (b - a)[:2].norm()])
        away = torch.stack(sides).abs() / lengths[:, None, None]  # from the lines through the sides, in samples
        clear &= (away > 1e-3).all(0)
    best, second = depths.topk(2, dim=0).values
    ids = torch.where(best > 0, depths.argmax(0), -1)
    return ids, best, clear & ((best - second > 1e-4) | (best == 0))


@dtypes
@backends
def test_the_nearest_triangle_at_each_sample(find: Rasterizer, dtype: torch.dtype) -> None:
    compared = 0
    for seed in range(6):
        points, faces = soup(seed)
        points = points.to(dtype)
        ids, inverse = find(points, faces, HEIGHT, WIDTH)
        assert (ids.dtype, inverse.dtype) == (torch.int64, dtype)
        for k in range(2):
            expected, w, clear = one_by_one(points[k], faces)
            assert torch.equal(ids[k][clear], expected[clear])
            tolerance = 1e-12 if dtype == torch.float64 else 2e-4  # that of planes of slivers
            assert_close(inverse[k][clear].double(), w[clear], rtol=0, atol=tolerance)
            compared += int(clear.sum())
    assert compared > 0.8 * 12 * HEIGHT * WIDTH


@dtypes
@backends
def test_no_holes_between_triangles(find: Rasterizer, dtype: torch.dtype) -> None:
    """A crumpled sheet over all of the image; in half of the cases its vertices lie on samples and between."""
    size = 16
    for seed in range(12):
        generator = torch.Generator().manual_seed(seed)
        x, y = torch.meshgrid(torch.linspace(-4, 35, size), torch.linspace(-4, 27, size), indexing="xy")
        flat = torch.stack([x, y], dim=2).reshape(-1, 2) + torch.rand(size * size, 2, generator=generator) - 0.5
        flat = (2 * flat).round() / 2 if seed % 2 else flat
        points = torch.cat([flat, 0.5 + 0.5 * torch.rand(size * size, 1, generator=generator)], dim=1)
        number = torch.arange(size * size).reshape(size, size)
        a, b, c, d = (part.flatten() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
        faces = torch.cat([torch.stack([a, b, c], 1), torch.stack([d, b, c], 1)])
        faces = faces[torch.randperm(len(faces), generator=generator)]
        turn = torch.randint(3, (len(faces), 1), generator=generator)
        faces = faces.gather(1, (turn + torch.arange(3)) % 3)  # the corners in any order
        ids, _ = find(points[None].to(dtype), faces, HEIGHT, WIDTH)
        assert (ids >= 0).all()


def triangle(w: float, size: float = 100.0) -> list[list[float]]:
    return [[-size, -size, w], [3 * size, -size, w], [-size, 3 * size, w]]


@dtypes
@backends
def test_of_equal_depths_the_first_is_seen(find: Rasterizer, dtype: torch.dtype) -> None:
    small = [[3.3, 2.2, 0.3], [28.1, 4.4, 0.3], [9.9, 20.8, 0.3]]
    points = torch.tensor([small + triangle(0.3) + small], dtype=dtype)
    ids, _ = find(points, torch.arange(9).reshape(3, 3), HEIGHT, WIDTH)
    assert set(ids.unique().tolist()) == {0, 1}
    ids, _ = find(points, torch.arange(9).reshape(3, 3)[[1, 2, 0]], HEIGHT, WIDTH)
    assert (ids == 0).all()


@dtypes
@backends
def test_triangles_of_no_area_and_those_behind_are_not_seen(find: Rasterizer, dtype: torch.dtype) -> None:
    line = [[2.5, 2.5, 0.5], [9.5, 9.5, 0.5], [5.5, 5.5, 0.5]]
    points = torch.tensor(
        [line + [[5, 5, 0.5]] * 3 + triangle(-0.5) + triangle(0.0) + triangle(float("nan")) + [[3, 3, -1.0]]],
        dtype=dtype,
    )
    faces = torch.cat([torch.arange(15).reshape(5, 3), torch.tensor([[0, 1, 15], [0, 0, 1]])])
    ids, inverse = find(points, faces, HEIGHT, WIDTH)
    assert (ids == -1).all()
    assert not inverse.any()


WIDE = Camera.from_field_of_view(60, 30, 40)
NEAR = 0.25


def triangles(seed: int, count: int = 30) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(6, 3, generator=generator, dtype=torch.float64)
    faces = torch.stack([torch.randperm(6, generator=generator)[:3] for _ in range(count)])
    return points, faces, torch.rand(count, 3, generator=generator, dtype=torch.float64)


def area(points: Tensor, faces: Tensor) -> float:
    a, b, c = points[faces].unbind(1)
    return float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)


@given(st.integers(0, 1000))
def test_both_sides_of_the_plane_together_are_all(seed: int) -> None:
    points, faces, corners = triangles(seed)
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
    points, faces, _ = triangles(seed, 1)
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
    points, faces, corners = triangles(3, 4)

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
def test_an_object_behind_the_camera_is_not_seen(method: EdgeMethod) -> None:
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
