"""Meshes: what they may hold, reading them from files of every format, refusing what is no mesh."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from trimesh.exchange.ply import export_ply
from trimesh.exchange.stl import export_stl_ascii
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from nablahog.render import mesh_bytes, mesh_file
from nablahog.render.mesh import Mesh, load_mesh

CORNERS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "0 0 1", "1 0 1", "1 1 1", "0 1 1"]
QUADS = ["0 1 2 3", "4 5 6 7", "0 1 5 4", "1 2 6 5", "2 3 7 6", "3 0 4 7"]
CUBE_OFF = "\n".join(["OFF", "8 6 0", *CORNERS, *(f"4 {quad}" for quad in QUADS)]) + "\n"
VERTICES_OBJ = "".join(f"v {corner}\n" for corner in CORNERS)
TRIANGLE = "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n"
RED, GREEN, BLUE = 0.299, 0.587, 0.114


def _write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def _area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)


def _check_cube(mesh: Mesh) -> None:
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    torch.testing.assert_close(mesh.vertices.abs(), torch.full((8, 3), 0.5 / 3**0.5, dtype=torch.float64))
    assert _area(mesh) == pytest.approx(6 / 3)  # a side is 1/√3
    assert (mesh.vertices.dtype, mesh.faces.dtype, mesh.brightness.dtype) == (torch.float64, torch.int64, torch.float64)


def _glb(header: Any, binary: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def _triangle_glb(**changes: Any) -> bytes:
    """A GLB of one triangle with corners at 0, 2x and y, and ``changes`` of its header."""
    binary = np.array([0, 0, 0, 2, 0, 0, 0, 1, 0], "<f4").tobytes()
    header: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "bufferView": 0, "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    return _glb(header | changes, binary)


# the mesh itself


def test_normalized_is_centred_with_diagonal_one() -> None:
    vertices = torch.tensor([[1.0, 2, 3], [4, 2, 3], [1, 6, 15]], dtype=torch.float64, requires_grad=True)
    mesh = Mesh(vertices, torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64)).normalized()
    expected = torch.tensor([[-1.5, -2, -6], [1.5, -2, -6], [-1.5, 2, 6]], dtype=torch.float64) / 13
    torch.testing.assert_close(mesh.vertices.detach(), expected)
    assert mesh.vertices.requires_grad


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_normalized_of_extreme_units(scale: float) -> None:
    vertices = scale * torch.tensor([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]], dtype=torch.float64)
    mesh = Mesh(vertices, torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64)).normalized()
    expected = torch.tensor([[-0.3, -0.4, 0], [0.3, -0.4, 0], [-0.3, 0.4, 0]], dtype=torch.float64)
    torch.testing.assert_close(mesh.vertices, expected)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vertices": torch.zeros(3, 2, dtype=torch.float64)}, r"vertices must be float64 of shape \(3, 3\), got"),
        ({"vertices": torch.zeros(3, 3)}, "vertices must be float64 .*, got float32"),
        ({"vertices": torch.full((3, 3), float("nan"), dtype=torch.float64)}, "vertices must be finite"),
        ({"faces": torch.zeros(0, 3, dtype=torch.int64)}, "at least one face"),
        ({"faces": torch.tensor([[0, 1, 3]])}, "faces must refer to the vertices 0…2, got 3"),
        ({"faces": torch.tensor([[0, -1, 2]])}, "faces must refer to the vertices 0…2, got -1"),
        ({"faces": torch.tensor([[0, 1, 2, 2]])}, r"faces must be int64 of shape \(1, 3\), got"),
        ({"brightness": torch.ones(2, dtype=torch.float64)}, "brightness must be float64"),
        ({"brightness": torch.full((3,), 1.5, dtype=torch.float64)}, "brightness must lie in 0…1"),
        ({"brightness": torch.full((3,), float("nan"), dtype=torch.float64)}, "brightness must lie in 0…1"),
    ],
)
def test_mesh_refuses(changes: dict[str, torch.Tensor], message: str) -> None:
    good = {
        "vertices": torch.eye(3, dtype=torch.float64),
        "faces": torch.tensor([[0, 1, 2]]),
        "brightness": torch.ones(3, dtype=torch.float64),
    }
    with pytest.raises(ValueError, match=message):
        Mesh(**(good | changes))


def test_one_point_cannot_be_normalized() -> None:
    mesh = Mesh(torch.zeros(3, 3, dtype=torch.float64), torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64))
    with pytest.raises(ValueError, match="extent above 0"):
        mesh.normalized()


# formats


@pytest.mark.parametrize("ending", ["off", "obj", "ply", "stl", "glb", "OFF"])
def test_cube_of_every_format(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"cube.{ending}"
    path.write_bytes(_bytes(trimesh.creation.box().export(file_type=ending.lower())))
    mesh = load_mesh(path)
    _check_cube(mesh)
    assert (mesh.brightness == 0.8).all()


def _bytes(export: Any) -> bytes:
    return export.encode() if isinstance(export, str) else export


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", export_ply(trimesh.creation.box(), encoding="ascii")),
        ("a.stl", export_stl_ascii(trimesh.creation.box())),
        ("quads.off", CUBE_OFF),
        ("counts_beside.off", CUBE_OFF.replace("OFF\n", "OFF ")),
        ("remarks.off", "# one\n" + CUBE_OFF.replace("8 6 0\n", "8 6 0 # two\n\n")),
        ("latin.off", b"# si\xe8ge\n" + CUBE_OFF.encode()),
        (
            "quads.obj",
            VERTICES_OBJ + "".join("f " + " ".join(str(int(i) + 1) for i in q.split()) + "\n" for q in QUADS),
        ),
    ],
)
def test_cube_by_hand(tmp_path: Path, name: str, content: str | bytes) -> None:
    _check_cube(load_mesh(_write(tmp_path, name, content)))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.off", "OFF 5 2 0\n0 0 0\n2 0 0\n3 1 0\n1 2 0\n0 1 0\n5 0 1 2 3 4\n3 0 1 2\n"),
        (
            "colours.off",
            "COFF 5 2 0\n0 0 0 9 9 9\n2 0 0 9 9 9\n3 1 0 9 9 9\n1 2 0 9 9 9\n0 1 0 9 9 9\n5 0 1 2 3 4\n2 0 1\n",
        ),
        ("a.obj", "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\nf 1 2 3\n"),
        ("same.obj", "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\n"),
    ],
)
def test_polygons_become_triangles(tmp_path: Path, name: str, content: str) -> None:
    mesh = load_mesh(_write(tmp_path, name, content), up="z")
    assert len(mesh.faces) == 3  # the triangle that repeats one of the pentagon's is dropped
    assert _area(mesh) == pytest.approx(4 / 13)  # the shoelace formula; the box is 3x2


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
    mesh = load_mesh(_write(tmp_path, "a.ply", head.encode() + body))
    assert len(mesh.faces) == 3
    assert _area(mesh) == pytest.approx((1.5 + 1) / 5)
    torch.testing.assert_close(mesh.brightness, torch.full((4,), RED, dtype=torch.float64))


def test_glb_applies_the_nodes_places(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for x in (0, 9):
        scene.add_geometry(trimesh.creation.box(), transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    mesh = load_mesh(_write(tmp_path, "two.glb", scene.export(file_type="glb")))
    extent = mesh.vertices.amax(0) - mesh.vertices.amin(0)
    torch.testing.assert_close(extent, torch.tensor([10.0, 1, 1], dtype=torch.float64) / 102**0.5)
    assert (len(mesh.vertices), len(mesh.faces)) == (16, 24)


@pytest.mark.parametrize(("ending", "up"), [("obj", None), ("off", "y"), ("glb", None), ("ply", "y")])
def test_y_up_becomes_z_up(tmp_path: Path, ending: str, up: Any) -> None:
    """A wedge that is 2 high and whose thin end is in front."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)]  # x right, y up, z to the front
    wedge = trimesh.Trimesh(corners, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])
    path = tmp_path / f"a.{ending}"
    path.write_bytes(_bytes(wedge.export(file_type=ending)))
    vertices = load_mesh(path, up=up).vertices * 14**0.5
    front, top = vertices[vertices[:, 1].argmin()], vertices[vertices[:, 2].argmax()]
    torch.testing.assert_close(front, torch.tensor([-0.5, -1.5, -1], dtype=torch.float64), atol=1e-6, rtol=0)
    torch.testing.assert_close(top, torch.tensor([-0.5, 1.5, 1], dtype=torch.float64), atol=1e-6, rtol=0)


def test_off_is_taken_as_z_up(tmp_path: Path) -> None:
    mesh = load_mesh(_write(tmp_path, "a.off", "OFF 3 1 0\n0 0 0\n1 0 0\n0 0 4\n3 0 1 2\n"))
    assert (mesh.vertices.amax(0) - mesh.vertices.amin(0)).argmax() == 2


def test_obj_counts_back_from_the_last_vertex_read(tmp_path: Path) -> None:
    forward = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 5\nv 1 0 5\nv 0 2 5\nf 4 5 6\nf 1 2 4\n"
    backward = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 5\nv 1 0 5\nv 0 2 5\nf -3 -2 \\\n -1\nf 1 2 -3\n"
    a = load_mesh(_write(tmp_path, "a.obj", forward))
    b = load_mesh(_write(tmp_path, "b.obj", backward))
    assert torch.equal(a.vertices[a.faces], b.vertices[b.faces])


def test_no_area_repeated_and_unused_are_dropped(tmp_path: Path) -> None:
    text = "OFF 6 5 0\n0 0 0\n1 0 0\n0 1 0\n2 0 0\n0 0 99\n0 1 0\n"
    text += "3 0 1 2\n3 0 1 3\n3 1 1 2\n3 2 1 0\n3 0 1 5\n"  # collinear, one corner twice, reversed, by an equal vertex
    mesh = load_mesh(_write(tmp_path, "a.off", text))
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
        path.write_bytes(_bytes(coloured.export(file_type=ending)))
        torch.testing.assert_close(load_mesh(path).brightness.sort()[0], gray.sort()[0], atol=2e-3, rtol=0)
    rows = ["0 0 0 255 0 0 255", "1 0 0 0 255 0 255", "0 1 0 0 0 255 255"]
    off = load_mesh(_write(tmp_path, "a.off", "COFF\n3 1 0\n" + "\n".join(rows) + "\n3 0 1 2\n"))
    torch.testing.assert_close(off.brightness.sort()[0], gray.sort()[0])
    off = load_mesh(_write(tmp_path, "b.off", "COFF\n3 1 0\n" + "\n".join(rows).replace("255", "1") + "\n3 0 1 2\n"))
    torch.testing.assert_close(off.brightness.sort()[0], gray.sort()[0])


def test_face_colours_of_ply(tmp_path: Path) -> None:
    mesh = trimesh.Trimesh(np.eye(3), [(0, 1, 2)], face_colors=[(0, 255, 0, 255)], process=False)
    path = _write(tmp_path, "a.ply", export_ply(mesh))
    torch.testing.assert_close(load_mesh(path).brightness, torch.full((3,), GREEN, dtype=torch.float64))


def test_mtl_diffuse_by_material(tmp_path: Path) -> None:
    _write(
        tmp_path, "wood.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\nnewmtl si\xe8ge\nKd 0 1 0\n".encode("latin-1")
    )
    text = VERTICES_OBJ + "usemtl a\nf 1 2 3\nusemtl b\nf 5 6 7\nusemtl si\xe8ge\nf 1 2 6\nusemtl c\nf 3 4 8\n"
    mesh = load_mesh(_write(tmp_path, "a.obj", ("mtllib wood.mtl\n" + text).encode("latin-1")))
    by_face = mesh.brightness[mesh.faces]
    assert (by_face == by_face[:, :1]).all()
    torch.testing.assert_close(
        by_face[:, 0].sort()[0], torch.tensor([BLUE, RED, GREEN, 0.8], dtype=torch.float64), atol=1e-9, rtol=0
    )


def _textured(folder: Path, mtl: str) -> Mesh:
    _write(folder, "a.mtl", mtl)
    uv = "vt 0.25 0.75\nvt 0.75 0.75\nvt 0.25 -0.75\n"
    text = "mtllib a.mtl\nusemtl m\n" + TRIANGLE.replace("f 1 2 3", uv + "f 1/1 2/2 3/3")
    return load_mesh(_write(folder, "a.obj", text), up="z")


def test_texture_at_the_vertices(tmp_path: Path) -> None:
    levels = np.repeat(np.repeat(np.array([[10, 20], [30, 40]], np.uint8), 200, axis=0), 200, axis=1)
    Image.fromarray(levels).save(tmp_path / "t.png")
    mesh = _textured(tmp_path, "newmtl m\nKd 0 0 0\nmap_Kd t.png\n")
    by_place = {tuple((v * 20**0.5).round().tolist()): b for v, b in zip(mesh.vertices, mesh.brightness, strict=True)}
    # v points up, and textures repeat
    assert [round(float(b) * 255) for _, b in sorted(by_place.items())] == [10, 30, 20]


@pytest.mark.parametrize("name", ["missing.png", "damaged.png", "../outside.png", "pipe.png"])
def test_unreadable_texture_leaves_the_colour(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "models"
    folder.mkdir()
    os.mkfifo(folder / "pipe.png")
    _write(folder, "damaged.png", b"\x89PNG\r\n\x1a\n nothing else")
    Image.new("L", (4, 4), 255).save(tmp_path / "outside.png")
    mesh = _textured(folder, f"newmtl m\nKd 0 1 0\nmap_Kd {name}\n")
    torch.testing.assert_close(mesh.brightness, torch.full((3,), GREEN, dtype=torch.float64))


def test_truncated_texture_leaves_the_colour(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "t.png")
    _write(tmp_path, "t.png", (tmp_path / "t.png").read_bytes()[:1000])
    mesh = _textured(tmp_path, "newmtl m\nKd 0 1 0\nmap_Kd t.png\n")
    torch.testing.assert_close(mesh.brightness, torch.full((3,), GREEN, dtype=torch.float64))


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    _write(tmp_path, "outside.mtl", "newmtl m\nKd 0 1 0\n")
    (tmp_path / "models").mkdir()
    for named in ("../outside.mtl", str(tmp_path / "outside.mtl")):
        path = _write(tmp_path / "models", "a.obj", f"mtllib {named}\nusemtl m\n" + TRIANGLE)
        assert (load_mesh(path).brightness == 0.8).all()


def test_materials_of_glb(tmp_path: Path) -> None:
    def loaded(material: PBRMaterial | SimpleMaterial) -> Mesh:
        visual = trimesh.visual.TextureVisuals(uv=np.array([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8)]), material=material)
        mesh = trimesh.Trimesh([(0, 0, 0), (2, 0, 0), (0, 1, 0)], [(0, 1, 2)], visual=visual, process=False)
        return load_mesh(_write(tmp_path, "a.glb", mesh.export(file_type="glb")))

    half = loaded(PBRMaterial(baseColorFactor=[0.0, 1.0, 0.0, 1.0]))
    torch.testing.assert_close(half.brightness, torch.full((3,), GREEN, dtype=torch.float64))
    dark = loaded(PBRMaterial(baseColorTexture=Image.new("RGB", (8, 8), (51, 51, 51))))
    torch.testing.assert_close(dark.brightness, torch.full((3,), 0.2, dtype=torch.float64))
    both = loaded(
        PBRMaterial(baseColorTexture=Image.new("RGB", (8, 8), (51, 51, 51)), baseColorFactor=[0.0, 1.0, 0.0, 1.0])
    )
    torch.testing.assert_close(both.brightness, torch.full((3,), 0.2 * GREEN, dtype=torch.float64))


def test_vertex_colours_of_glb_multiply_the_material(tmp_path: Path) -> None:
    binary = np.array([0, 0, 0, 2, 0, 0, 0, 1, 0, *[0.5] * 9], "<f4").tobytes()
    accessor = {"componentType": 5126, "type": "VEC3", "count": 3, "bufferView": 0}
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}}],
        "accessors": [accessor, accessor | {"byteOffset": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 72}],
        "buffers": [{"byteLength": 72}],
    }
    mesh = load_mesh(_write(tmp_path, "a.glb", _glb(header, binary)))
    torch.testing.assert_close(mesh.brightness, torch.full((3,), GREEN / 2, dtype=torch.float64))


# what is refused


def test_missing_folder_and_unknown(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_mesh(tmp_path / "none.off")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(ValueError, match="got a folder"):
        load_mesh(tmp_path / "folder.off")
    os.mkfifo(tmp_path / "pipe.off")
    with pytest.raises(ValueError, match="got a special file"):
        load_mesh(tmp_path / "pipe.off")
    for name in ("a.dae", "a.gltf", "a.zip", "a"):
        with pytest.raises(ValueError, match=r"expected a mesh file \(.off, .obj, .ply, .stl, .glb\), got the ending"):
            load_mesh(_write(tmp_path, name, CUBE_OFF))
    with pytest.raises(ValueError, match="up must be"):
        load_mesh(_write(tmp_path, "a.off", CUBE_OFF), up="x")  # type: ignore[arg-type]


PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n"
)
BINARY_STL = _bytes(trimesh.creation.box().export(file_type="stl"))
BINARY_PLY = _bytes(trimesh.creation.box().export(file_type="ply"))
BAD_FACES = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
BAD_INDICES = [
    {"componentType": 5126, "type": "VEC3", "bufferView": 0, "count": 3},
    {"componentType": 5121, "type": "SCALAR", "bufferView": 0, "count": 36},
]


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        *((f"empty.{kind}", b"", "cannot be read") for kind in ("off", "obj", "ply", "stl", "glb")),
        *((f"noise.{kind}", bytes(range(256)) * 4, "cannot be read") for kind in ("off", "obj", "ply", "stl", "glb")),
        ("a.off", CUBE_OFF[:-11], "promises 8 vertices and 6 faces"),
        ("a.off", CUBE_OFF[:-5], "should have 4 corners, and has 2"),
        ("a.off", CUBE_OFF.replace("8 6 0", "8 60000000000000000000000 0"), "promises"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4 8"), "outside the range"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4 -1"), "outside the range"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1 nan 1"), "not finite"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1 -inf 1"), "not finite"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1 one 1"), "cannot be read"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1e308 1 1").replace("0 1 1", "-1e308 1 1"), "below infinity"),
        ("a.off", "OFF 3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "no faces"),
        ("a.off", "OFF 3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", "area above 0"),
        ("a.off", "OFF 3 1 0\n1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n", "extent above 0"),
        ("a.obj", VERTICES_OBJ, "no faces"),
        ("a.obj", VERTICES_OBJ + "l 1 2 3\n", "no faces"),
        ("a.obj", VERTICES_OBJ + "f 1 2 9\n", "cannot be read"),
        ("a.obj", VERTICES_OBJ + "f 0 1 2\n", "refers to 0"),
        ("a.obj", VERTICES_OBJ + "f 1 2 -9\n", "refers to -9"),
        ("a.obj", VERTICES_OBJ + "f 1 2 x\n", "cannot be read"),
        ("a.obj", "v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "three coordinates"),
        ("a.obj", TRIANGLE.replace("2 0 0", "nan 0 0"), "not finite"),
        ("a.ply", PLY_HEAD + "3 0 1 2\n", "promises 2 rows of the element face, but has 1"),
        ("a.ply", PLY_HEAD + "3 0 1 2\n3 0 1 3\n", "does not hold"),
        ("a.ply", PLY_HEAD[:60], "header"),
        ("a.ply", BINARY_PLY[:-5], "cannot be read"),
        ("a.ply", BINARY_PLY.replace(b"element face 12", b"element face 99999999999"), "cannot be read"),
        ("a.stl", BINARY_STL[:-5], "length that it promises"),
        ("a.stl", BINARY_STL[:80] + b"\xff\xff\xff\xff" + BINARY_STL[84:], "length that it promises"),
        ("a.stl", BINARY_STL[:96] + struct.pack("<f", float("nan")) + BINARY_STL[100:], "not finite"),
        ("a.stl", export_stl_ascii(trimesh.creation.box())[:700], "from solid to endsolid"),
        ("a.glb", _triangle_glb()[:-8], "truncated"),
        ("a.glb", _triangle_glb(buffers=[{"byteLength": 36, "uri": "../secret.bin"}]), "needs the file"),
        ("a.glb", _triangle_glb(extensionsRequired=["KHR_draco_mesh_compression"]), "not supported"),
        ("a.glb", _triangle_glb(accessors=[{"componentType": 5126, "type": "VEC3", "count": 10**12}]), "at most"),
        ("a.glb", _triangle_glb(bufferViews=[{"buffer": 0, "byteLength": 10**12}]), "at most"),
        ("a.glb", _triangle_glb(nodes=[{"mesh": 0}] * 10_001), "at most 10,000 nodes"),
        ("a.glb", _triangle_glb(nodes=[{"children": [1, 1]}, {"mesh": 0}]), "no tree"),
        ("a.glb", _triangle_glb(nodes=[{"children": [1]}, {"mesh": 0, "children": [0]}]), "in a circle"),
        ("a.glb", _triangle_glb(nodes=[{"mesh": 0, "scale": [float("nan"), 1, 1]}]), "not finite"),
        ("a.glb", _triangle_glb(meshes=BAD_FACES, accessors=BAD_INDICES), "does not hold"),
        ("a.glb", _triangle_glb(meshes=[]), "cannot be read"),
        ("a.glb", _glb([1, 2, 3]), "cannot be read"),
        ("a.glb", b"glTF" + struct.pack("<III", 2, 0, 99_999) + b"JSON" + b"[" * 99_999, "cannot be read"),
    ],
)
def test_damaged_files_are_refused_in_one_sentence(
    tmp_path: Path, name: str, content: str | bytes, reason: str
) -> None:
    path = _write(tmp_path, name, content)
    with pytest.raises(ValueError, match=reason) as caught:
        load_mesh(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert "charset" not in message  # no parser may ask for what is not installed


def test_a_whole_triangle_glb_is_read(tmp_path: Path) -> None:
    """What the refused ones above differ from."""
    mesh = load_mesh(_write(tmp_path, "a.glb", _triangle_glb()))
    assert (len(mesh.vertices), len(mesh.faces)) == (3, 1)


def test_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _write(tmp_path, "a.off", CUBE_OFF)
    monkeypatch.setattr(mesh_file, "MAX_FACES", 11)
    with pytest.raises(ValueError, match="at most 11 faces are allowed, got 12"):
        load_mesh(path)
    monkeypatch.setattr(mesh_file, "MAX_BYTES", 100)
    with pytest.raises(ValueError, match="more than 100 bytes is refused"):
        load_mesh(path)
    assert mesh_bytes.MAX_FACES >= 1_000_000
