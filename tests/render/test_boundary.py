"""What people pass to meshes, cameras and renderings: taken as it is meant, or refused."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest
import torch
from numpy.testing import assert_allclose

import nablahog.render.renderer as renderer
from nablahog.render import Camera, Mesh, Renderer, load_mesh, pose, render

CORNERS = [[-0.5, 0.0, -0.5], [0.5, 0.0, -0.5], [0.0, 0.0, 0.5]]
CAMERA = Camera(64.0, 32, 24)


def triangle() -> Mesh:
    return Mesh(CORNERS, [[0, 1, 2]], [0.2, 0.2, 0.2])  # type: ignore[arg-type]


def test_poses_cannot_be_mapped_over() -> None:
    with pytest.raises(ValueError, match="outside of"):
        torch.func.vmap(lambda at: render(triangle(), at[None], CAMERA))(pose(20))


def test_a_background_of_one_level_has_its_derivative() -> None:
    level = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    render(triangle(), pose(20), CAMERA, background=level).sum().backward()
    bright, dark = (render(triangle(), pose(20), CAMERA, background=behind).double().sum() for behind in (0.6, 0.4))
    assert float(level.grad) == pytest.approx(float(bright - dark) / 0.2, rel=1e-4)  # type: ignore[arg-type]


def test_planes_of_faces_are_computed_once_for_all_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    planes = Mock(wraps=renderer.face_planes)
    monkeypatch.setattr(renderer, "face_planes", planes)
    drawn = Renderer(triangle(), CAMERA)
    for focal in (50.0, 60.0, 70.0):
        drawn.with_camera(Camera(focal, 32, 24))(pose(20))
    assert planes.call_count <= 1


def test_colours_of_vertices_under_a_plain_off(tmp_path: Path) -> None:
    rows = "".join(f"{x} {y} {z} 51 51 51\n" for x, y, z in CORNERS)
    path = tmp_path / "a.off"
    path.write_text(f"OFF\n3 1 0\n{rows}3 0 1 2\n")
    assert_allclose(load_mesh(path).brightness, 0.2)
    path.write_text(f"OFF\n3 1 0\n{rows.replace('51 51 51', '0 -1 0')}3 0 1 2\n")  # normals
    assert_allclose(load_mesh(path).brightness, 0.8)
