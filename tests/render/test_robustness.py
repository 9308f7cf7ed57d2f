"""Whatever is rendered from wherever: an image without NaN, and derivatives without."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose
from nablahog.render.renderer import EdgeMethod

from .shapes import CAMERA, box, cylinder, joined, mesh, poses

WIDE = Camera.from_field_of_view(60, 30, 40)
VIEWS = {
    "from above": pose(10, 90, 3),
    "from below": pose(10, -90, 3),
    "in the plane of a side": pose(0, 0, 0.5),
    "inside": pose(33, 20, 0.1),
    "in its middle": pose(33, 20, 1e-6),
    "on a corner": pose(45, math.degrees(math.atan(math.sqrt(0.5))), math.sqrt(0.75)),
    "far away": pose(33, 20, 1e7),
    "outside the frame": pose(33, 20, 3, 0, 500, 0),
    "half outside the frame": pose(33, 20, 3, 0, 20, 15),
    "upside down": pose(33, 200, 3, 180),
}
methods = pytest.mark.parametrize("method", ["edges", "opendr"])


def check(renderer: Renderer, where: Tensor) -> None:
    """Compiled and plain: finite images in 0…1 and finite derivatives by all there is."""
    camera = renderer.camera
    one = renderer.mesh
    with torch.no_grad():
        depth, normals = depth_and_normals(one, where, camera)
    assert not torch.isnan(depth).any()
    assert torch.isfinite(normals).all()
    for dtype in (torch.float32, torch.float64):
        behind = torch.full((1, 1, camera.height, camera.width), 0.3, dtype=dtype)
        followed = where.clone().requires_grad_()
        image = renderer(followed, behind)
        assert image.min() >= 0  # NaN fails too
        assert image.max() <= 1
        weights = torch.randn_like(image)
        assert torch.isfinite(torch.autograd.grad((image * weights).sum(), followed)[0]).all()
    parts = [one.vertices.clone().requires_grad_(), one.brightness.clone().requires_grad_()]
    varied = Renderer(
        Mesh(parts[0], one.faces, parts[1]), camera, method=renderer.method, supersampling=renderer.supersampling
    )
    image = varied(where, behind)
    for slope in torch.autograd.grad((image * weights).sum(), parts):
        assert torch.isfinite(slope).all()


@methods
@pytest.mark.parametrize("where", VIEWS.values(), ids=VIEWS.keys())
def test_any_view(where: Tensor, method: EdgeMethod) -> None:
    check(Renderer(box(), WIDE, method=method, supersampling=1), where)


@methods
def test_soups_of_slivers_and_degenerate_triangles(method: EdgeMethod) -> None:
    """No area at all, next to none, the same triangle twice, vertices of no triangle."""
    generator = torch.Generator().manual_seed(0)
    vertices = torch.rand(60, 3, generator=generator, dtype=torch.float64) - 0.5
    for k, size in enumerate((0.0, 1e-17, 1e-9, 1e-6, 1e-4, 1e-2)):
        part = slice(10 * k, 10 * k + 10, 2)
        vertices[10 * k + 1 : 10 * k + 10 : 2] = vertices[part] + size
    faces = torch.randint(60, (80, 3), generator=generator)
    close = torch.arange(0, 60, 2)[:, None] + torch.tensor([0, 1, 0])
    close[:, 2] = torch.randint(60, (30,), generator=generator)
    faces = torch.cat([faces, close, faces[:9], faces[:5].flip(1), torch.tensor([[3, 3, 3], [4, 4, 7]])])
    one = mesh(vertices, faces, torch.rand(60, generator=generator).tolist())
    for step in (1, 2):
        check(Renderer(one, CAMERA, method=method, supersampling=step), poses(4, 13))
    check(Renderer(one, WIDE, method=method, supersampling=1), pose(20, 10, 0.3))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@methods
def test_on_a_gpu_as_on_a_cpu(method: EdgeMethod) -> None:
    # no two surfaces in one plane: which of them is nearer is rounding
    one, where = joined(box((1.1, 1.1, 0.9)), cylinder(24)), poses(3, 13)
    there = Mesh(one.vertices.cuda(), one.faces.cuda(), one.brightness.cuda())
    behind = torch.rand(1, 1, 48, 40, dtype=torch.float64)
    slopes, images = [], []
    for mesh_there, at, background in ((one, where, behind), (there, where.cuda(), behind.cuda())):
        at = at.clone().requires_grad_()
        image = Renderer(mesh_there, CAMERA, method=method, supersampling=2)(at, background)
        weights = torch.linspace(0, 40, image.numel(), dtype=torch.float64, device=at.device).cos().view(image.shape)
        slopes.append(torch.autograd.grad((image * weights).sum(), at)[0].cpu())
        images.append(image.detach().cpu())
        depth, normals = depth_and_normals(mesh_there, at.detach(), CAMERA)
        images.append(torch.cat([torch.where(torch.isinf(depth), 0, depth)[:, None], normals], 1).cpu())
    torch.testing.assert_close(images[0], images[2], rtol=0, atol=1e-6)
    torch.testing.assert_close(images[1], images[3], rtol=0, atol=1e-6)
    torch.testing.assert_close(slopes[0], slopes[1], rtol=1e-4, atol=1e-4)
