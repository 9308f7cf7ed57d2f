"""The compiled rendering against the one in PyTorch: equal images, up to rounding in float32.

Derivatives by the pose agree up to some percent, fewer with smaller pixels: PyTorch moves every crossing of an edge by
the motion of the edge there, the compiled loops by that of its surface in the middle of the pixel.  With ``opendr``,
the part of a silhouette drawn outside its surface has no depth of its own: PyTorch continues the triangle's plane, the
compiled loops take the depth at the next sample, which differs much for faces seen from the side.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from torch import Tensor
from torch.nn.functional import cosine_similarity
from torch.testing import assert_close

from nablahog.datasets.chairs import chair
from nablahog.render import Camera, Mesh, Renderer, pose, pose_jacobian, pose_vjp, silhouette
from nablahog.render.kernels.pose import moments
from nablahog.render.renderer import Method

from ..shapes import box, cylinder, joined, poses

CAMERA = Camera.from_field_of_view(25, 72, 64)
MESHES = {
    "box": box((0.6, 0.5, 0.5)),
    "round": joined(cylinder(24), box((1.5, 0.2, 0.3))).normalized(),
    "chair": chair(2),
    "other chair": chair(0),
}
meshes = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
methods = pytest.mark.parametrize("method", ["edges", "opendr"])
steps = pytest.mark.parametrize("step", [1, 2, 4])


def plain(renderer: Renderer, where: Tensor, background: Tensor) -> Tensor:
    """The plain steps in float32: those are taken where a background is differentiated by."""
    return renderer(where, background.clone().requires_grad_()).detach()


def plain_jacobian(renderer: Renderer, where: Tensor, background: Tensor) -> Tensor:
    """(6, B, H, W)."""
    behind = background.clone().requires_grad_()
    units = torch.eye(6, dtype=torch.float64)[:, None].expand(6, len(where), 6)
    images = [torch.func.jvp(lambda p: renderer(p, behind), (where,), (unit,))[1] for unit in units]
    return torch.stack(images)[:, :, 0].detach()


def compiled_jacobian(renderer: Renderer, where: Tensor, background: Tensor) -> Tensor:
    rendering = renderer.compiled.render(where, background[:, 0], True)
    return pose_jacobian(rendering.screen_gradient, where, renderer.camera).transpose(0, 1)


@meshes
@methods
@steps
def test_images(mesh: Mesh, method: Method, step: int) -> None:
    renderer = Renderer(mesh, CAMERA, method=method, supersampling=step)
    where, background = poses(3, 2.6), torch.rand(3, 1, 72, 64)
    result, expected = renderer(where, background), plain(renderer, where, background)
    assert (result - background).abs().max() > 0.3
    different = (result - expected).abs() > 1e-3
    assert different.float().mean() < 1e-3  # a sample right on an edge falls on either side
    assert (result - expected).abs().mean() < 1e-5


@meshes
@methods
@steps
def test_derivatives(mesh: Mesh, method: Method, step: int) -> None:
    renderer = Renderer(mesh, CAMERA, method=method, supersampling=step)
    where, background = poses(2, 2.6), torch.rand(1, 1, 72, 64) * 0.2
    result, expected = (
        jacobian(renderer, where, background).double() for jacobian in (compiled_jacobian, plain_jacobian)
    )
    error = (result - expected).flatten(1).norm(dim=1) / expected.flatten(1).norm(dim=1)
    assert error[4:].max() < 2e-2, error  # a shift moves all alike; a tie falls to either side
    if method == "edges":
        assert error.max() < (0.05, 0.03, 0.03)[step // 2], error
    else:
        assert error[2] < 0.04
        assert cosine_similarity(result.flatten(1), expected.flatten(1)).min() > (0.7, 0.85, 0.95)[step // 2]


@methods
def test_reverse_mode_is_the_adjoint_of_the_jacobian(method: Method) -> None:
    renderer = Renderer(MESHES["chair"], CAMERA, method=method, supersampling=2)
    where, background = poses(3, 2.6), torch.rand(1, 1, 72, 64)
    grad_image = torch.randn(3, 72, 64)
    rendering = renderer.compiled.render(where, background[:, 0], True)
    expected = (pose_jacobian(rendering.screen_gradient, where, CAMERA) * grad_image[:, None]).sum((2, 3))
    assert_close(pose_vjp(grad_image, rendering.screen_gradient, where, CAMERA), expected, rtol=1e-3, atol=1e-2)
    followed = where.clone().requires_grad_()
    (reverse,) = torch.autograd.grad((renderer(followed, background)[:, 0] * grad_image).sum(), followed)
    assert_close(reverse, expected.double(), rtol=1e-3, atol=1e-2)
    assert_close(rendering.image, renderer(where, background)[:, 0], rtol=0, atol=1e-6)


@methods
def test_near_the_camera_too(method: Method) -> None:
    """Inside the object, half of which is cut off."""
    one = joined(cylinder(24, caps=False), box((0.3, 0.2, 0.4)))
    where = torch.cat([pose(20, 10, 0.45), pose(200, -30, 0.4), pose(90, 80, 0.6)])
    renderer = Renderer(one, Camera.from_field_of_view(100, 72, 64), method=method, supersampling=2)
    background = torch.rand(1, 1, 72, 64)
    result, expected = renderer(where, background), plain(renderer, where, background)
    print(((result - expected).abs() > 2e-3).float().mean(), (result - expected).abs().mean())
    assert ((result - expected).abs() > 2e-3).float().mean() < 5e-3


def test_images_of_any_size_after_each_other() -> None:
    """Their scratch memory is shared."""
    where, result = poses(2, 2.6), []
    sizes = [(72, 64), (10, 120), (72, 64), (1, 1), (200, 3), (72, 64)]
    for height, width in sizes:
        camera = Camera(CAMERA.focal, height, width)
        for mesh in (MESHES["chair"], MESHES["box"]):
            renderer = Renderer(mesh, camera, supersampling=2)
            image = renderer(where, torch.full((1, 1, height, width), 0.3))
            expected = plain(renderer, where, torch.full((1, 1, height, width), 0.3))
            assert ((image - expected).abs() > 1e-3).float().mean() < 2e-3
        result.append(image)
    assert torch.equal(result[0], result[2])
    assert torch.equal(result[0], result[5])


def test_threads_do_not_disturb_each_other() -> None:
    renderers = [Renderer(mesh, CAMERA, supersampling=2) for mesh in MESHES.values()]
    where = poses(4, 2.6)
    alone = [renderer(where) for renderer in renderers]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda renderer: renderer(where), renderers * 4))
    for k, image in enumerate(together):
        assert torch.equal(image, alone[k % 4])


def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    renderer, where = Renderer(MESHES["chair"], CAMERA), poses(5, 2.6)
    one = renderer(where)
    torch.set_num_threads(2)
    try:
        assert torch.equal(renderer(where), one)
    finally:
        torch.set_num_threads(1)


def test_sums_over_pixels_are_those_of_plain_pytorch() -> None:
    grad_image, screen_gradient = torch.randn(3, 7, 9), torch.randn(3, 4, 7, 9)
    x, y = torch.randn(3, 1, 9), torch.randn(3, 7, 1)
    result = moments(grad_image, screen_gradient, x, y)
    powers_of_x = torch.stack([x**m for m in range(3)], 1)  # (B, 3, 1, W)
    powers_of_y = torch.stack([y**n for n in range(3)], 1)
    expected = torch.einsum("bhw,bkhw,bmow,bnhp->bkmn", grad_image, screen_gradient, powers_of_x, powers_of_y)
    assert_close(result, expected.double(), rtol=1e-4, atol=1e-4)
    inside = torch.func.vmap(lambda g: moments(g, screen_gradient, x, y))(grad_image[None])
    assert_close(inside[0], result, rtol=1e-5, atol=1e-5)


@methods
@pytest.mark.parametrize("size", [1e-20, 1e12, 1e30])
def test_sizes_near_the_end_of_numbers_draw_something_or_nothing(method: Method, size: float) -> None:
    huge = MESHES["box"].vertices * size
    renderer = Renderer(Mesh(huge, MESHES["box"].faces, MESHES["box"].brightness), CAMERA, method=method)
    for distance in (2.6 * size, 0.1 * size, 2.6):
        where = poses(2, distance)
        rendering = renderer.compiled.render(where, torch.ones(1, 72, 64), True)
        assert torch.isfinite(rendering.image).all()


def test_silhouettes_are_compiled_and_plain_the_same() -> None:
    mesh, where = MESHES["chair"], poses(2, 2.6)
    result = silhouette(mesh, where, CAMERA)
    vertices = mesh.vertices.clone().requires_grad_()
    expected = silhouette(Mesh(vertices, mesh.faces, mesh.brightness), where, CAMERA).detach()
    assert (result - expected).abs().mean() < 1e-5
    assert math.isclose(float(result.sum()), float(expected.sum()), rel_tol=1e-4)
