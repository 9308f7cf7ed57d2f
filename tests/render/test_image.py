"""The image: how much of each pixel is covered, with what brightness, before which background."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose, render, silhouette
from nablahog.render.renderer import EdgeMethod

from .shapes import CAMERA, FLAT, box, joined, mesh, poses, quads, rectangle, upright

IN_FRONT = pose(0, distance=3)
methods = pytest.mark.parametrize("method", ["edges", "opendr"])
dtypes = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["compiled", "plain"])


def on(background: float, dtype: torch.dtype, camera: Camera = CAMERA, count: int = 1) -> Tensor:
    return torch.full((count, 1, camera.height, camera.width), background, dtype=dtype)


def covered(low: float, high: float, size: int) -> Tensor:
    """How much of each of ``size`` pixels in a row lies between ``low`` and ``high``."""
    start = torch.arange(size, dtype=torch.float64)
    return (start.add(1).clamp(max=high) - start.clamp(min=low)).clamp(min=0)


@dtypes
@pytest.mark.parametrize("step", [1, 2, 3, 4])
@pytest.mark.parametrize("sides", [(5.3, 3.6, 20.8, 30.25), (9.95, 8.05, 30.45, 40.55), (4.4, 4.6, 9.7, 9.3)])
def test_sides_of_a_rectangle_cover_pixels_by_their_share(
    sides: tuple[float, float, float, float], step: int, dtype: torch.dtype
) -> None:
    """Exactly, except at corners, where shares of samples add up instead of multiplying."""
    one = rectangle(*sides, CAMERA)
    image = render(one, IN_FRONT, CAMERA, background=on(0.1, dtype), light=FLAT, supersampling=step)[0, 0]
    x, y = covered(sides[0], sides[2], 40), covered(sides[1], sides[3], 48)
    expected = 0.1 + 0.7 * y[:, None] * x
    corner = ((y > 0) & (y < 1))[:, None] & ((x > 0) & (x < 1))
    assert_close(image[~corner].double(), expected[~corner], rtol=0, atol=3e-6)
    assert (image - expected)[corner].abs().max() <= 0.7 / 4 / step**2 + 1e-6


@dtypes
def test_slanted_sides_cover_pixels_by_their_share(dtype: torch.dtype) -> None:
    """Where a side crosses no more than one pixel of a row, its share is a trapezium, exactly."""
    slope, start = 0.3, 10.2
    corners = [(start, 0), (start + 48 * slope, 48), (38, 48), (38, 0)]
    one = mesh(upright(corners, CAMERA, 3), quads([(0, 1, 2, 3)]), 1.0)
    image = render(one, IN_FRONT, CAMERA, background=on(0.0, dtype), light=FLAT, supersampling=1)[0, 0]
    for row in range(48):
        upper, lower = start + row * slope, start + (row + 1) * slope
        middle = (upper + lower) / 2
        result = float(image[row, :38].sum())
        assert result == pytest.approx(38 - middle, abs=1e-5)  # whatever pixel it is given to, none is lost
        if math.floor(upper) == math.floor(lower):
            assert float(image[row, math.floor(upper)]) == pytest.approx(math.ceil(middle) - middle, abs=1e-5)


@dtypes
@methods
@pytest.mark.parametrize("step", [1, 2])
def test_a_batch_is_its_images_one_by_one(method: EdgeMethod, step: int, dtype: torch.dtype) -> None:
    renderer = Renderer(box(), CAMERA, method=method, supersampling=step)
    where = poses(5, 13)
    for background in (on(0.2, dtype), torch.rand(5, 1, 48, 40, dtype=dtype)):
        images = renderer(where, background)
        assert (images.shape, images.dtype) == ((5, 1, 48, 40), dtype)
        for k in range(5):
            one = background[k : k + 1] if len(background) > 1 else background
            assert torch.equal(images[k : k + 1], renderer(where[k : k + 1], one))


@dtypes
@methods
def test_the_background_shows_where_nothing_is(method: EdgeMethod, dtype: torch.dtype) -> None:
    picture = torch.rand(1, 1, 48, 40, dtype=dtype)
    renderer = Renderer(box(), CAMERA, method=method)
    where = poses(1, 13)
    image = renderer(where, picture)
    share = silhouette(box(), where, CAMERA)
    untouched = torch.nn.functional.max_pool2d(share, 3, 1, 1) == 0
    assert untouched.sum() > 300
    assert_close(image[untouched], picture[untouched])
    inside = torch.nn.functional.max_pool2d(1 - share, 3, 1, 1) == 0
    assert inside.sum() > 200
    assert_close(image[inside], renderer(where, 1 - picture)[inside])
    away = pose(0, distance=13, x=1e4)
    assert_close(renderer(away, picture), picture)


@dtypes
def test_brightness_is_linear_on_the_surface_not_on_the_screen(dtype: torch.dtype) -> None:
    """A road that goes far away and gets brighter all along."""
    camera = Camera.from_field_of_view(60, 40, 40)
    road = mesh([(-9, -2, -1), (9, -2, -1), (9, 12, -1), (-9, 12, -1)], quads([(0, 1, 2, 3)]), [0, 0, 1, 1])
    image = render(road, IN_FRONT, camera, background=on(0.0, dtype, camera), light=FLAT, supersampling=1)[0, 0]
    rows = torch.arange(24, 40, dtype=torch.float64)
    far = camera.focal / (rows + 0.5 - 20)  # where the ray through a row meets the plane 1 below the camera
    expected = ((far - 3 + 2) / 14).clamp(min=0)
    assert_close(image[24:, 10:30].double(), expected[:, None].expand(-1, 20), rtol=0, atol=2e-5)


@dtypes
def test_nearer_things_hide_others(dtype: torch.dtype) -> None:
    near, far = rectangle(10, 10, 20, 30, CAMERA, 2.0, 0.2), rectangle(5, 15, 35, 40, CAMERA, 3.0, 0.6)
    both = joined(Mesh(near.vertices - torch.tensor([0, 1.0, 0]), near.faces, near.brightness), far)
    for one in (both, Mesh(both.vertices, both.faces.flip(0), both.brightness)):
        image = render(one, IN_FRONT, CAMERA, background=on(1.0, dtype), light=FLAT)[0, 0]
        expected = torch.ones(48, 40, dtype=dtype)
        expected[15:40, 5:35] = 0.6
        expected[10:30, 10:20] = 0.2
        assert_close(image, expected, rtol=0, atol=1e-5)


@dtypes
def test_theta_turns_the_picture_counter_clockwise(dtype: torch.dtype) -> None:
    square = Camera(300.0, 40, 40)
    one, at = box((0.5, 1, 1.5)), pose(30, 20, 13)
    turned = render(one, at + pose(0, 0, 0, 90), square, background=on(1, dtype, square))
    upright = render(one, at, square, background=on(1, dtype, square))
    assert_close(turned, upright.rot90(1, (2, 3)), rtol=0, atol=1e-4)


@dtypes
def test_the_front_is_seen_at_azimuth_0_and_the_right_side_at_90(dtype: torch.dtype) -> None:
    sides = {"front": (0, 0.1), "x": (90, 0.3), "back": (180, 0.5), "-x": (270, 0.7)}
    for azimuth, brightness in sides.values():
        a = math.radians(azimuth)
        towards = torch.tensor([math.sin(a), -math.cos(a), 0.0], dtype=torch.float64)
        core = box((0.9, 0.9, 0.9), 1.0)
        plate = box((0.2, 0.2, 0.2), brightness)
        plate = Mesh(plate.vertices + 0.5 * towards, plate.faces, plate.brightness)
        image = render(joined(core, plate), pose(azimuth, distance=13), CAMERA, background=on(1, dtype), light=FLAT)
        assert float(image[0, 0, 24, 20]) == pytest.approx(brightness, abs=1e-5)


def test_silhouettes() -> None:
    share = silhouette(rectangle(5.3, 3.6, 20.8, 30.25, CAMERA, brightness=0.0), IN_FRONT, CAMERA)
    assert share.shape == (1, 1, 48, 40)
    assert float(share.sum()) == pytest.approx((20.8 - 5.3) * (30.25 - 3.6), abs=0.1)
    assert share.min() == 0
    assert share.max() == 1


def test_depths_and_normals() -> None:
    """Seen from above or in front of its middle, a box shows one side, half a unit nearer than the middle."""
    depth, normals = depth_and_normals(box(), torch.cat([pose(0, 90, 13), pose(0, 0, 13)]), CAMERA)
    assert (depth.shape, normals.shape) == ((2, 48, 40), (2, 3, 48, 40))
    for k in range(2):
        seen = torch.isfinite(depth[k])
        assert_close(depth[k][seen], torch.full_like(depth[k][seen], 12.5))
        assert_close(normals[k][:, seen].T, torch.tensor([0.0, 0, -1]).double().expand(int(seen.sum()), 3))
        assert not normals[k][:, ~seen].any()
        assert 400 < seen.sum() < 48 * 40


@pytest.mark.parametrize("background", [1.5, torch.full((1, 1, 48, 40), -0.5), torch.ones(1, 1, 40, 48)])
def test_no_background(background: float | Tensor) -> None:
    with pytest.raises(ValueError, match=r"^the background must "):
        render(box(), poses(2, 13), CAMERA, background=background)
