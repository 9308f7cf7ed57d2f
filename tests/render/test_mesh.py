"""Meshes: what they may hold, reading them from files of every format."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial

from nablahog.render.mesh import Mesh, axes, load_mesh

from .mesh_files import TRIANGLE, VERTICES_OBJ, Glb, as_bytes, surface_area, write

RED, GREEN, BLUE = 0.299, 0.587, 0.114


# the mesh itself


def test_normalized_is_centred_with_diagonal_one() -> None:
    vertices = torch.tensor([[1.0, 2, 3], [4, 2, 3], [1, 6, 15]], dtype=torch.float64, requires_grad=True)
    mesh = Mesh(vertices, torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64)).normalized()
    expected = torch.tensor([[-1.5, -2, -6], [1.5, -2, -6], [-1.5, 2, 6]], dtype=torch.float64) / 13
    torch.testing.assert_close(mesh.vertices.detach(), expected)
    assert mesh.vertices.requires_grad


def test_one_point_cannot_be_normalized() -> None:
    mesh = Mesh(torch.zeros(3, 3, dtype=torch.float64), torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64))
    with pytest.raises(ValueError, match="extent between"):
        mesh.normalized()


# formats


@pytest.mark.parametrize("ending", ["off", "obj", "ply", "stl", "glb", "OFF"])
def test_cube_of_every_format(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"cube.{ending}"
    path.write_bytes(as_bytes(trimesh.creation.box().export(file_type=ending.lower())))
    mesh = load_mesh(path)
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    torch.testing.assert_close(mesh.vertices.abs(), torch.full((8, 3), 0.5 / 3**0.5, dtype=torch.float64))
    assert surface_area(mesh) == pytest.approx(6 / 3)  # a side is 1/√3
    assert (mesh.vertices.dtype, mesh.faces.dtype, mesh.brightness.dtype) == (torch.float64, torch.int64, torch.float64)
    assert (mesh.brightness == 0.8).all()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.off", "OFF 5 3 0\n0 0 0\n2 0 0\n3 1 0\n1 2 0\n0 1 0\n5 0 1 2 3 4\n3 0 1 2\n2 0 1\n"),
        ("a.obj", "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\nf 1 2 3\n"),
    ],
)
def test_polygons_become_triangles(tmp_path: Path, name: str, content: str) -> None:
    mesh = load_mesh(write(tmp_path, name, content), up="z")
    assert len(mesh.faces) == 3  # the triangle that repeats one of the pentagon's is dropped
    assert surface_area(mesh) == pytest.approx(4 / 13)  # the shoelace formula; the box is 3x2


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_of_mixed_polygons(tmp_path: Path, order: str) -> None:
    kind = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{kind}_endian 1.0\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nelement face 2\nproperty uchar flags\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 2, 0)]
    body = b"".join(struct.pack(f"{order}3f3B", *corner, 255, 0, 0) for corner in corners)
    body += struct.pack(f"{order}BB4i", 7, 4, 0, 1, 2, 3) + struct.pack(f"{order}BB3i", 7, 3, 0, 1, 3)
    mesh = load_mesh(write(tmp_path, "a.ply", head.encode() + body))
    assert len(mesh.faces) == 3
    assert surface_area(mesh) == pytest.approx((1.5 + 1) / 5)
    torch.testing.assert_close(mesh.brightness, torch.full((4,), RED, dtype=torch.float64))


@pytest.mark.parametrize(("ending", "up"), [("obj", None), ("off", "y"), ("glb", None), ("ply", "y")])
def test_y_up_becomes_z_up(tmp_path: Path, ending: str, up: Any) -> None:
    """A wedge that is 2 high and whose thin end is in front."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)]  # x right, y up, z to the front
    wedge = trimesh.Trimesh(corners, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])
    path = tmp_path / f"a.{ending}"
    path.write_bytes(as_bytes(wedge.export(file_type=ending)))
    vertices = load_mesh(path, up=up).vertices * 14**0.5
    front, top = vertices[vertices[:, 1].argmin()], vertices[vertices[:, 2].argmax()]
    torch.testing.assert_close(front, torch.tensor([-0.5, -1.5, -1], dtype=torch.float64), atol=1e-6, rtol=0)
    torch.testing.assert_close(top, torch.tensor([-0.5, 1.5, 1], dtype=torch.float64), atol=1e-6, rtol=0)


@pytest.mark.parametrize(
    ("up", "front", "rows"),
    [
        ("z", None, ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
        ("+y", None, ((1, 0, 0), (0, 0, -1), (0, 1, 0))),
        ("z", "x", ((0, 1, 0), (-1, 0, 0), (0, 0, 1))),
        ("-z", "-y", ((-1, 0, 0), (0, 1, 0), (0, 0, -1))),
        ("x", "+z", ((0, -1, 0), (0, 0, -1), (1, 0, 0))),
    ],
)
def test_axes(up: str, front: str | None, rows: tuple[tuple[int, ...], ...]) -> None:
    """Up goes to +z and the front to -y, without a mirror."""
    turned = np.array(axes(up, front))
    assert turned.tolist() == np.array(rows).tolist()
    assert np.linalg.det(turned) == pytest.approx(1)


@pytest.mark.parametrize(
    ("up", "front", "message"),
    [("-y", None, "no usual front"), ("w", None, "up must be one of x, y and z"), ("y", "y", "must be two axes")],
)
def test_axes_that_are_none(up: str, front: str | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        axes(up, front)


def test_no_area_repeated_and_unused_are_dropped(tmp_path: Path) -> None:
    text = "OFF 6 5 0\n0 0 0\n1 0 0\n0 1 0\n2 0 0\n0 0 99\n0 1 0\n"
    text += "3 0 1 2\n3 0 1 3\n3 1 1 2\n3 2 1 0\n3 0 1 5\n"  # collinear, one corner twice, reversed, by an equal vertex
    mesh = load_mesh(write(tmp_path, "a.off", text))
    assert mesh.faces.tolist() in ([[0, 1, 2]], [[1, 2, 0]], [[2, 0, 1]], [[0, 2, 1]], [[2, 1, 0]], [[1, 0, 2]])
    extent = mesh.vertices.amax(0) - mesh.vertices.amin(0)
    torch.testing.assert_close(extent, torch.tensor([1.0, 1, 0], dtype=torch.float64) / 2**0.5)


# brightness


def test_vertex_colours(tmp_path: Path) -> None:
    gray = torch.tensor([RED, GREEN, BLUE], dtype=torch.float64)
    coloured = trimesh.Trimesh(
        np.eye(3), [(0, 1, 2)], vertex_colors=[(255, 0, 0), (0, 255, 0), (0, 0, 255)], process=False
    )
    for ending in ("ply", "obj", "glb"):
        path = tmp_path / f"a.{ending}"
        path.write_bytes(as_bytes(coloured.export(file_type=ending)))
        torch.testing.assert_close(load_mesh(path).brightness.sort()[0], gray.sort()[0], atol=2e-3, rtol=0)


def test_mtl_diffuse_by_material(tmp_path: Path) -> None:
    write(tmp_path, "wood.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\nnewmtl si\xe8ge\nKd 0 1 0\n".encode("latin-1"))
    text = VERTICES_OBJ + "usemtl a\nf 1 2 3\nusemtl b\nf 5 6 7\nusemtl si\xe8ge\nf 1 2 6\nusemtl c\nf 3 4 8\n"
    mesh = load_mesh(write(tmp_path, "a.obj", ("mtllib wood.mtl\n" + text).encode("latin-1")))
    by_face = mesh.brightness[mesh.faces]
    assert (by_face == by_face[:, :1]).all()
    torch.testing.assert_close(
        by_face[:, 0].sort()[0], torch.tensor([BLUE, RED, GREEN, 0.8], dtype=torch.float64), atol=1e-9, rtol=0
    )


def _textured(folder: Path, mtl: str) -> Mesh:
    write(folder, "a.mtl", mtl)
    uv = "vt 0.25 0.75\nvt 0.75 0.75\nvt 0.25 -0.75\n"
    text = "mtllib a.mtl\nusemtl m\n" + TRIANGLE.replace("f 1 2 3", uv + "f 1/1 2/2 3/3")
    return load_mesh(write(folder, "a.obj", text), up="z")


def test_texture_at_the_vertices(tmp_path: Path) -> None:
    levels = np.repeat(np.repeat(np.array([[10, 20], [30, 40]], np.uint8), 200, axis=0), 200, axis=1)
    Image.fromarray(levels).save(tmp_path / "t.png")
    mesh = _textured(tmp_path, "newmtl m\nKd 0 0 0\nmap_Kd t.png\n")
    by_place = {tuple((v * 20**0.5).round().tolist()): b for v, b in zip(mesh.vertices, mesh.brightness, strict=True)}
    # v points up, and textures repeat
    assert [round(float(b) * 255) for _, b in sorted(by_place.items())] == [10, 30, 20]


@pytest.mark.parametrize("name", ["missing.png", "damaged.png", "cut.png", "../outside.png", "pipe.png"])
def test_unreadable_texture_leaves_the_colour(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "models"
    folder.mkdir()
    os.mkfifo(folder / "pipe.png")
    write(folder, "damaged.png", b"\x89PNG\r\n\x1a\n nothing else")
    Image.new("L", (4, 4), 255).save(folder / "cut.png")
    write(folder, "cut.png", (folder / "cut.png").read_bytes()[:45])
    Image.new("L", (4, 4), 255).save(tmp_path / "outside.png")
    mesh = _textured(folder, f"newmtl m\nKd 0 1 0\nmap_Kd {name}\n")
    torch.testing.assert_close(mesh.brightness, torch.full((3,), GREEN, dtype=torch.float64))


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    write(tmp_path, "outside.mtl", "newmtl m\nKd 0 1 0\n")
    (tmp_path / "models").mkdir()
    for named in ("../outside.mtl", str(tmp_path / "outside.mtl")):
        path = write(tmp_path / "models", "a.obj", f"mtllib {named}\nusemtl m\n" + TRIANGLE)
        assert (load_mesh(path).brightness == 0.8).all()


TEXTURE = {"baseColorTexture": Image.new("RGB", (8, 8), (51, 51, 51))}
FACTOR = {"baseColorFactor": [0.0, 1.0, 0.0, 1.0]}


@pytest.mark.parametrize(("material", "brightness"), [(FACTOR, GREEN), (TEXTURE, 0.2), (TEXTURE | FACTOR, 0.2 * GREEN)])
def test_materials_of_glb(tmp_path: Path, material: dict[str, Any], brightness: float) -> None:
    places = np.array([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8)])
    visual = trimesh.visual.TextureVisuals(uv=places, material=PBRMaterial(**material))
    made = trimesh.Trimesh([(0, 0, 0), (2, 0, 0), (0, 1, 0)], [(0, 1, 2)], visual=visual, process=False)
    mesh = load_mesh(write(tmp_path, "a.glb", made.export(file_type="glb")))
    torch.testing.assert_close(mesh.brightness, torch.full((3,), brightness, dtype=torch.float64))


@pytest.mark.parametrize(("count", "brightness"), [(3, GREEN / 2), (4, GREEN)])  # the latter are of other vertices
def test_vertex_colours_of_glb_multiply_the_material(tmp_path: Path, count: int, brightness: float) -> None:
    model = Glb([[0, 0, 0], [2, 0, 0], [0, 1, 0]], material=0)
    model.primitive["attributes"]["COLOR_0"] = model.add(np.full((count, 3), 0.5, "<f4"))
    green = {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}}
    mesh = load_mesh(write(tmp_path, "a.glb", model.data(materials=[green])))
    torch.testing.assert_close(mesh.brightness, torch.full((3,), brightness, dtype=torch.float64))
