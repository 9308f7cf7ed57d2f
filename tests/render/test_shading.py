"""Brightness: A (ambient + diffuse |n·l|), smooth over small angles and flat elsewhere."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Light, Mesh
from nablahog.render.surface import corner_brightness, corner_normals, smoothing_groups

from .shapes import box, cylinder

LIGHT = Light((1, -2, 3), 0.3, 0.7)


def shaded(one: Mesh, light: Light = LIGHT) -> Tensor:
    return corner_brightness(one, smoothing_groups(one), light)


def test_the_sides_of_a_box() -> None:
    """Opposite sides alike: |n·l|.  The default light tells all three apart."""
    length = math.sqrt(1 + 4 + 9)
    for brightness in (1.0, 0.5):
        result = shaded(box((1, 2, 3), brightness))
        for k, along in enumerate((1, 2, 3)):  # four triangles of each pair of sides
            expected = torch.full((4, 3), brightness * (0.3 + 0.7 * along / length), dtype=torch.float64)
            assert_close(result[4 * k : 4 * k + 4], expected)


def test_smooth_sides_and_sharp_rims() -> None:
    one = cylinder(24)
    normals = corner_normals(one, smoothing_groups(one))
    at = one.vertices[one.faces]
    sides = at[..., 2].std(1) > 0
    radial = at * torch.tensor([2.0, 2, 0])
    assert_close((normals * radial).sum(2).abs()[sides], torch.ones(48, 3, dtype=torch.float64), rtol=0, atol=1e-2)
    assert_close(normals[~sides].abs(), torch.tensor([0.0, 0, 1], dtype=torch.float64).expand(44, 3, 3))
    # the side's two triangles weigh 2 : 1 or 1 : 2 in a corner, so that it is not exactly between both sides
    assert (normals * radial).sum(2).abs()[sides].min() > math.cos(math.radians(15 / 4))


def test_albedo_is_a_factor() -> None:
    one = cylinder(24)
    albedo = torch.rand(len(one.vertices), dtype=torch.float64)
    result = shaded(Mesh(one.vertices, one.faces, albedo))
    assert_close(result, shaded(one) / 0.8 * albedo[one.faces])
    assert result.min() >= 0
    assert result.max() <= 1


def test_derivatives() -> None:
    one = cylinder(9)
    smooth = smoothing_groups(one)

    def brightness(vertices: Tensor, albedo: Tensor) -> Tensor:
        return corner_brightness(Mesh(vertices, one.faces, albedo), smooth, LIGHT)

    inputs = one.vertices.clone().requires_grad_(), one.brightness.clone().requires_grad_()
    assert torch.autograd.gradcheck(brightness, inputs, check_forward_ad=True)


def test_triangles_of_no_area_are_dark_and_harmless() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], dtype=torch.float64, requires_grad=True)
    one = Mesh(vertices, torch.tensor([[0, 1, 2], [0, 1, 3], [1, 1, 3]]), torch.ones(4, dtype=torch.float64))
    result = shaded(one)
    assert_close(result[[0, 2]], torch.full((2, 3), 0.3, dtype=torch.float64))
    (slope,) = torch.autograd.grad(result.sum(), vertices)
    assert torch.isfinite(slope).all()


@pytest.mark.parametrize("direction", [(0, 0, 0), (math.nan, 0, 1), (math.inf, 0, 0), (1, 2)])
def test_no_direction(direction: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="three finite numbers, not all 0"):
        Light(direction)


@pytest.mark.parametrize(("ambient", "diffuse"), [(-0.1, 0.5), (0.5, -0.1), (0.6, 0.6), (math.nan, 0.1)])
def test_no_light(ambient: float, diffuse: float) -> None:
    with pytest.raises(ValueError, match="at least 0, and at most 1 together"):
        Light(ambient=ambient, diffuse=diffuse)
