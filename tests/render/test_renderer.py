"""The native loops of the renderer against the plain steps in PyTorch, which share no code with them.

Images are equal up to rounding in float32, and so is the derivative by the motion of surfaces, but for the part of a
silhouette that ``opendr`` draws outside its surface, which has no depth of its own: PyTorch continues the triangle's
plane, the loops take the depth at the next sample.  Where a sample is right on an edge, rounding decides.
"""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from nablahog import native
from nablahog.render import Camera, Mesh, Renderer, pose, pose_jacobian, render
from nablahog.render.edge_gradient import GAP, TOUCHING
from nablahog.render.rasterize import NEAR
from nablahog.render.renderer import EdgeMethod, Rendering
from nablahog.render.surface import BOUNDARY, face_planes

from ..chairs import chair
from ..hog.zoo import threads
from .shapes import box, cylinder, joined, poses

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
needs_loops = pytest.mark.skipif(not native.available(), reason="there are no compiled loops to compare with")


def plain(renderer: Renderer, where: Tensor, background: Tensor) -> Rendering:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "library", lambda: None)
        return renderer.render(where, background, derivative=True)


def check_alike(result: Rendering, expected: Rendering, on_edges: float, screen_gradient: float) -> None:
    """Images differ in a share ``on_edges`` of pixels at most; screen gradients relative to all, in the 2-norm."""
    assert result.screen_gradient.shape == expected.screen_gradient.shape
    different = (result.image - expected.image).abs() > 1e-5
    assert different.float().mean() < on_edges
    assert (result.image - expected.image).abs().mean() < 1e-5
    error = (result.screen_gradient - expected.screen_gradient).norm() / expected.screen_gradient.norm()
    assert error < screen_gradient, error


@needs_loops
@meshes
@methods
@steps
def test_loops_and_plain_steps_draw_and_differentiate_alike(mesh: Mesh, method: EdgeMethod, step: int) -> None:
    renderer = Renderer(mesh, CAMERA, method=method, supersampling=step)
    where, background = poses(3, 2.6), torch.rand(3, 72, 64)
    result = renderer.render(where, background, derivative=True)
    assert (result.image - background).abs().max() > 0.3
    check_alike(result, plain(renderer, where, background), 1e-3, 0.02)
    assert torch.equal(renderer.render(where, background, derivative=False).image, result.image)


@needs_loops
@methods
def test_near_the_camera_too(method: EdgeMethod) -> None:
    """Inside the object, half of which is cut off."""
    one = joined(cylinder(24, caps=False), box((0.3, 0.2, 0.4)))
    where = torch.cat([pose(20, 10, 0.45), pose(200, -30, 0.4), pose(90, 80, 0.6)])
    renderer = Renderer(one, Camera.from_field_of_view(100, 72, 64), method=method, supersampling=2)
    background = torch.rand(1, 72, 64)
    result, expected = renderer.render(where, background, derivative=True), plain(renderer, where, background)
    assert expected.screen_gradient.abs().amax((1, 2, 3)).min() > 0.1
    check_alike(result, expected, 5e-3, 0.02)


@needs_loops
@pytest.mark.parametrize("side", [-1, 1])
def test_the_eye_in_the_plane_of_a_face(side: int) -> None:
    """Its edges are silhouettes, on either side of it."""
    one = box((0.6, 0.5, 0.5))
    renderer = Renderer(replace(one, vertices=one.vertices + torch.tensor([0, 0, side * 0.25])), CAMERA)
    where, background = pose(33, 0, 2.6), torch.zeros(1, 72, 64)
    result, expected = renderer.render(where, background, derivative=True), plain(renderer, where, background)
    check_alike(result, expected, 1e-3, 0.02)


@pytest.mark.parametrize("name", ["round", "chair"])
@pytest.mark.parametrize("step", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_derivatives_by_poses_are_exact_up_to_the_size_of_a_pixel(name: str, step: int) -> None:
    """All that is seen in a pixel is taken to move as the surface in its middle does."""
    renderer = Renderer(MESHES[name], CAMERA, supersampling=step)
    where, background = poses(2, 2.6), torch.rand(1, 72, 64) * 0.2
    rendering = renderer.render(where, background, derivative=True)
    result = pose_jacobian(rendering.screen_gradient, where, CAMERA).double().transpose(0, 1)
    behind = background[:, None].clone().requires_grad_()  # then the plain steps are taken
    units = torch.eye(6, dtype=torch.float64)[:, None].expand(6, 2, 6)
    exact = [torch.func.jvp(lambda p: renderer(p, behind), (where,), (unit,))[1] for unit in units]
    expected = torch.stack(exact)[:, :, 0].detach()
    error = (result - expected).flatten(1).norm(dim=1) / expected.flatten(1).norm(dim=1)
    assert error[4:].max() < 2e-2, error  # a shift moves all alike; a tie falls to either side
    assert error.max() < (0.05, 0.03, 0.03)[step // 2], error


def test_images_of_any_size_after_each_other() -> None:
    """Their scratch memory is shared."""
    where, result = poses(2, 2.6), []
    for height, width in [(72, 64), (10, 120), (72, 64), (1, 1), (200, 3), (72, 64)]:
        for mesh in (MESHES["chair"], MESHES["box"]):
            renderer = Renderer(mesh, Camera(CAMERA.focal, height, width), supersampling=2)
            background = torch.full((1, height, width), 0.3)
            image = renderer.render(where, background, derivative=False).image
            assert ((image - plain(renderer, where, background).image).abs() > 1e-3).float().mean() < 2e-3
        result.append(image)
    assert torch.equal(result[0], result[2])
    assert torch.equal(result[0], result[5])


def test_planes_of_faces_are_computed_once_for_all_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    planes = Mock(wraps=face_planes)
    monkeypatch.setattr("nablahog.render.renderer.face_planes", planes)
    drawn = Renderer(MESHES["box"], CAMERA)
    for focal in (50.0, 60.0, 70.0):
        drawn.with_camera(Camera(focal, 32, 24))(pose(20))
    assert planes.call_count <= 1


def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    renderer, where = Renderer(MESHES["chair"], CAMERA), poses(5, 2.6)
    one = renderer(where)
    with threads(2):
        assert torch.equal(renderer(where), one)


@needs_loops
def test_constants_are_those_of_the_plain_steps() -> None:
    constants = np.zeros(4)
    native.function("render_constants", native.array(np.float64))(constants)
    np.testing.assert_allclose(constants, [NEAR, GAP, TOUCHING, BOUNDARY], rtol=1e-6)


def test_a_mesh_of_trimesh_is_answered_with_what_to_write() -> None:
    with pytest.raises(TypeError, match=r"write mesh\.export\('mesh\.ply'\) and nablahog\.load_mesh\('mesh\.ply', up"):
        render(trimesh.creation.box(), pose(30), CAMERA)
