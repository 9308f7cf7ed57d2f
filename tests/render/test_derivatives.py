"""The ``edges`` method's derivatives against finite differences of its own images, and against what must come out.

Outlines, creases and flat brightness are differentiated exactly: pixels are piecewise smooth functions of the vertices.
Smooth shading moves with the surface, its change along the surface being taken between neighbouring samples; there the
derivative is compared with that of a finely sampled image.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad
from torch.nn.functional import avg_pool2d, cosine_similarity
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, pose, render
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.edge_gradient import silhouette_edges, surface_motion
from nablahog.render.renderer import EdgeMethod
from nablahog.render.surface import mesh_edges

from .shapes import CAMERA, FLAT, box, cylinder, joined, mesh, poses, rectangle, split

AT = pose(33.3, 27.7, 13.1, 7.7, 1.3, -2.1)
BEHIND = torch.full((1, 1, 48, 40), 0.1, dtype=torch.float64)
TRIANGLE = mesh([(-0.5, 0.1, -0.4), (0.6, -0.2, -0.3), (0.1, 0.2, 0.5)], [(0, 1, 2)])
TWO = joined(box((0.9, 0.7, 0.8), 0.6), mesh([(-0.5, -0.9, -0.4), (0.4, -1, -0.3), (0.1, -0.9, 0.6)], [(0, 1, 2)], 0.9))
SCENES = {"triangle": TRIANGLE, "box": split(box()), "triangle before a box": TWO}
scenes = pytest.mark.parametrize("one", SCENES.values(), ids=SCENES.keys())
methods = pytest.mark.parametrize("method", ["edges", "opendr"])


def difference(function: Callable[[Tensor], Tensor], at: Tensor, direction: Tensor, size: float = 1e-6) -> Tensor:
    return (function(at + size * direction) - function(at - size * direction)) / (2 * size)


def slope(function: Callable[[Tensor], Tensor], at: Tensor, direction: Tensor) -> Tensor:
    return torch.func.jvp(function, (at,), (direction,))[1]


@scenes
@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("k", range(6))
def test_by_poses(one: Mesh, step: int, k: int) -> None:
    renderer = Renderer(one, CAMERA, supersampling=step)
    at = pose(47, 34, 13.1, 7.7, 1.3, -2.1) if step == 1 else pose(-40, 40, 13, 0, 0.3, 0.4)
    direction = torch.eye(6, dtype=torch.float64)[k : k + 1]
    expected = difference(lambda p: renderer(p, BEHIND), at, direction)
    assert expected.abs().max() > 1e-3
    assert_close(slope(lambda p: renderer(p, BEHIND), at, direction), expected, rtol=1e-5, atol=1e-6)


@scenes
def test_by_vertices(one: Mesh) -> None:
    """Every vertex for itself: outlines, creases and, as normals turn, brightness."""

    def image(vertices: Tensor) -> Tensor:
        return render(Mesh(vertices, one.faces, one.brightness), AT, CAMERA, background=BEHIND, supersampling=2)

    direction = torch.randn(one.vertices.shape, dtype=torch.float64)
    if len(direction) > 20:  # vertices at one place stay together
        direction = box().vertices[box().faces.flatten()] @ torch.randn(3, 3, dtype=torch.float64)
    expected = difference(image, one.vertices, direction)
    assert expected.abs().max() > 0.1
    assert_close(slope(image, one.vertices, direction), expected, rtol=1e-5, atol=1e-5)


@scenes
def test_by_brightness_and_background(one: Mesh) -> None:
    """Linear in each: any step will do."""
    picture = torch.rand(1, 1, 48, 40, dtype=torch.float64) * 0.8 + 0.1

    def by_brightness(albedo: Tensor) -> Tensor:
        return render(Mesh(one.vertices, one.faces, albedo), AT, CAMERA, background=picture, supersampling=2)

    def by_background(behind: Tensor) -> Tensor:
        return render(one, AT, CAMERA, background=behind, supersampling=2)

    direction = torch.rand(len(one.brightness), dtype=torch.float64) - 0.5
    expected = difference(by_brightness, one.brightness, direction, 0.1)
    assert_close(slope(by_brightness, one.brightness, direction), expected)
    direction = torch.rand(picture.shape, dtype=torch.float64) - 0.5
    expected = difference(by_background, picture, direction, 0.1)
    assert_close(slope(by_background, picture, direction), expected)


def test_by_a_background_of_one_level() -> None:
    level = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    render(TRIANGLE, AT, CAMERA, background=level).sum().backward()
    bright, dark = (render(TRIANGLE, AT, CAMERA, background=behind).double().sum() for behind in (0.6, 0.4))
    assert_close(level.grad, (bright - dark) / 0.2, rtol=1e-4, atol=0)


def test_poses_cannot_be_mapped_over() -> None:
    with pytest.raises(ValueError, match="outside of"):
        torch.func.vmap(lambda at: render(TRIANGLE, at[None], CAMERA))(AT)


def test_what_depends_on_no_image() -> None:
    """A function of the image without a derivative: the poses have none either."""

    class Constant(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, image: Tensor) -> Tensor:
            return image.clone()

        @staticmethod
        def backward(ctx: Any, _: Tensor) -> None:
            return None

    at = AT.clone().requires_grad_()
    Constant.apply(Renderer(TRIANGLE, CAMERA)(at)).sum().backward()  # type: ignore[no-untyped-call]
    assert at.grad is None


def test_second_derivatives_are_refused() -> None:
    """By all that moves the image; it is linear in the background, whose Hessian there is."""
    renderer, behind = Renderer(TRIANGLE, CAMERA), torch.full((1, 1, CAMERA.height, CAMERA.width), 0.5)
    jvp, grad, along = torch.func.jvp, torch.func.grad, torch.ones_like(AT)

    def loss(at: Tensor, behind: Tensor) -> Tensor:
        return (renderer(at, behind) ** 2).sum()

    by_poses, by_background = grad(loss), grad(loss, argnums=1)
    for function, value, direction in (
        (lambda at: by_poses(at, behind), AT, along),
        (lambda at: by_background(at, behind), AT, along),
        (lambda behind: by_poses(AT, behind), behind, behind),
        (lambda at: jvp(lambda at: loss(at, behind), (at,), (along,))[1], AT, along),
        (lambda behind: jvp(lambda at: loss(at, behind), (AT,), (along,))[1], behind, behind),
    ):
        for twice in (
            lambda: jvp(function, (value,), (direction,)),  # noqa: B023
            lambda: grad(lambda x: function(x).sum())(value),  # noqa: B023
        ):
            with pytest.raises(NotImplementedError, match="differentiated"):
                twice()
    _, product = jvp(lambda behind: by_background(AT, behind), (behind,), (behind,))
    step = 0.01 * behind
    difference = (by_background(AT, behind + step) - by_background(AT, behind - step)) / 0.02
    torch.testing.assert_close(product, difference, rtol=1e-3, atol=1e-3)
    at = AT.clone().requires_grad_()
    (first,) = torch.autograd.grad(loss(at, behind), at, create_graph=True)
    with pytest.raises(NotImplementedError, match="differentiated once"):
        first.sum().backward()


@methods
def test_forward_is_reverse(method: EdgeMethod) -> None:
    """⟨w, J t⟩ = ⟨Jᵀ w, t⟩ for all that makes an image, together; by function transforms and by dual numbers."""
    one = joined(TWO, cylinder(24))

    def image(poses: Tensor, vertices: Tensor, albedo: Tensor, behind: Tensor) -> Tensor:
        return render(
            Mesh(vertices, one.faces, albedo), poses, CAMERA, background=behind, method=method, supersampling=2
        )

    inputs = (poses(2, 13), one.vertices, one.brightness, torch.rand(1, 1, 48, 40, dtype=torch.float64))
    tangents = tuple(torch.randn_like(each) for each in inputs)
    _, forward = torch.func.jvp(image, inputs, tangents)
    weights = torch.randn_like(forward)
    followed = tuple(each.clone().requires_grad_() for each in inputs)
    reverse = torch.autograd.grad((image(*followed) * weights).sum(), followed)
    transformed = torch.func.grad(lambda *each: (image(*each) * weights).sum(), argnums=(0, 1, 2, 3))(*inputs)
    total = sum((slope * tangent).sum() for slope, tangent in zip(reverse, tangents, strict=True))
    assert_close((forward * weights).sum(), total)
    for k in range(4):
        assert reverse[k].abs().max() > 0
        assert_close(transformed[k], reverse[k])
        with forward_ad.dual_level():
            dual = [forward_ad.make_dual(x, t) if i == k else x for i, (x, t) in enumerate(zip(inputs, tangents))]  # noqa: B905
            alone = forward_ad.unpack_dual(image(*dual)).tangent
        assert_close((alone * weights).sum(), (reverse[k] * tangents[k]).sum())


@methods
@pytest.mark.parametrize(("height", "width"), [(24, 16), (16, 24)])
def test_a_batch_is_its_images(height: int, width: int, method: EdgeMethod) -> None:
    """Of an object that reaches beyond all sides of the images."""
    renderer, at = Renderer(TWO, Camera(90.0, height, width), method=method, supersampling=1), poses(2, 4.5)
    behind = torch.full((1, 1, height, width), 0.1, dtype=torch.float64)

    def image_and_tangent(poses: Tensor) -> Any:
        return torch.func.jvp(lambda p: renderer(p, behind), (poses,), (torch.ones_like(poses),))

    assert_close(image_and_tangent(at), tuple(map(torch.cat, zip(*map(image_and_tangent, at.split(1)), strict=True))))


@methods
def test_forward_is_reverse_where_it_is_compiled(method: EdgeMethod) -> None:
    renderer = Renderer(TWO, CAMERA, method=method)
    at, picture = poses(2, 13), torch.rand(1, 1, 48, 40)

    def image(poses: Tensor) -> Tensor:
        return renderer(poses, picture)

    tangent = torch.randn_like(at)
    plain, forward = torch.func.jvp(image, (at,), (tangent,))
    assert torch.equal(plain, image(at))
    with forward_ad.dual_level():
        assert torch.equal(forward_ad.unpack_dual(image(forward_ad.make_dual(at, tangent))).tangent, forward)
    weights = torch.randn_like(forward)
    followed = at.clone().requires_grad_()
    (reverse,) = torch.autograd.grad((image(followed) * weights).sum(), followed)
    assert_close((forward * weights).sum().double(), (reverse * tangent).sum(), rtol=1e-4, atol=1e-4)
    assert_close(torch.func.grad(lambda p: (image(p) * weights).sum())(at), reverse, rtol=1e-5, atol=1e-5)
    columns = torch.func.jacfwd(image)(at)
    assert_close(torch.einsum("bchwnk,nk->bchw", columns, tangent.float()), forward, rtol=1e-4, atol=1e-4)


def test_the_area_of_a_square() -> None:
    """It is as 1 / distance², its middle moves with the shift, and turning it does nothing."""
    square = rectangle(9.3, 13.2, 30.7, 34.8, CAMERA, brightness=1.0)
    at = pose(0, distance=3).requires_grad_()
    image = render(square, at, CAMERA, background=BEHIND * 0, light=FLAT)[0, 0]
    (by_area,) = torch.autograd.grad(image.sum(), at, retain_graph=True)
    area = 21.4 * 21.6
    assert_close(by_area[0, 2], torch.tensor(-2 * area / 3, dtype=torch.float64), rtol=2e-3, atol=0)
    others = by_area[0, [0, 1, 3, 4, 5]]
    assert_close(others, torch.zeros_like(others), rtol=0, atol=5e-2)
    for k, places in ((4, torch.arange(40)), (5, torch.arange(48)[:, None])):
        (by_middle,) = torch.autograd.grad((image * (places + 0.5)).sum(), at, retain_graph=True)
        # a pixel's places are all that of its middle
        assert_close(by_middle[0, k], torch.tensor(area, dtype=torch.float64), rtol=3e-2, atol=0)


def fine(one: Mesh, at: Tensor, k: int, size: float) -> Tensor:
    renderer = Renderer(one, CAMERA, supersampling=16)
    direction = torch.eye(6, dtype=torch.float64)[k : k + 1]
    return difference(renderer, at, direction, size)


@pytest.mark.parametrize("step", [1, 2, 4])
def test_smooth_shading_and_surfaces_that_pass_through_each_other(step: int) -> None:
    """There no edge of the mesh says where brightness changes."""
    crossing = Mesh(box((1.3, 0.05, 0.9)).vertices, box().faces, torch.full((8,), 0.3, dtype=torch.float64))
    one = joined(cylinder(24), crossing)
    at = pose(33, 25, 13, 3)
    for k, size in ((0, 0.2), (1, 0.2), (2, 0.01), (3, 0.2)):
        expected = fine(one, at, k, size)
        direction = torch.eye(6, dtype=torch.float64)[k : k + 1]
        for background in (1.0, BEHIND * 0 + 1):
            renderer = Renderer(one, CAMERA, supersampling=step)
            result = slope(lambda p, r=renderer, b=background: r(p, b), at, direction)  # type: ignore[misc]
            blurred = (avg_pool2d(part.double(), 3, 1).flatten() for part in (result, expected))
            assert cosine_similarity(*blurred, dim=0) > (0.95 if step == 1 else 0.985)


WIDE = Camera.from_field_of_view(90, 40, 40)


def test_surfaces_move_as_their_points_do() -> None:
    """Of a point on a triangle that turns, bends and comes nearer, to where it is seen a moment later."""
    at = pose(20, 30, 2)
    corners = torch.randn(6, 3, 3, dtype=torch.float64) * 0.4
    velocity = torch.randn(6, 3, 3, dtype=torch.float64)
    weights = torch.rand(6, 3, dtype=torch.float64) + 0.1
    weights = weights / weights.sum(1, keepdim=True)

    def seen(points: Tensor) -> Tensor:
        return to_screen(to_camera(points.reshape(-1, 3), at), at, WIDE)

    def after(time: float) -> tuple[Tensor, Tensor]:
        moved = corners + time * velocity
        return seen(moved), seen((weights[..., None] * moved).sum(1))[0, :, :2]

    (early, before), (late, behind), (now, point) = after(-1e-6), after(1e-6), after(0)
    x, y = point.T
    faces, first = torch.arange(18).reshape(6, 3), torch.zeros(6, dtype=torch.int64)
    result = surface_motion(now, (late - early) / 2e-6, faces, first, x, y)
    assert_close(result, (behind - before) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("where", [pose(33, 20, 3), pose(33, 20, 0.6), pose(200, -40, 0.3), pose(75, 60, 0.1)])
def test_silhouettes_are_where_one_face_is_turned_to_the_camera_and_one_away(where: Tensor) -> None:
    """Also where the faces go on behind the camera; of edges that do so themselves, nothing is said."""
    one = joined(box(), cylinder(16), box((0.2, 0.3, 2)))
    result = mesh_edges(one)
    points = to_camera(one.vertices, where)
    a, b = points[0][result.ends].unbind(1)
    normals = torch.linalg.cross((b - a)[:, None], points[0][result.opposite] - a[:, None])
    sides = (normals * a[:, None]).sum(2)
    expected = sides[:, 0] * sides[:, 1] >= 0
    front = (points[0][result.ends][..., 2] > 1e-3).all(1)
    assert front.sum() > 5
    assert torch.equal(silhouette_edges(to_screen(points, where, WIDE), result)[0][front], expected[front])
