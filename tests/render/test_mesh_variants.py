"""Mesh files as people's programs write them: a cube, and its brightness, in each of their ways."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray
from PIL import Image

from nablahog.render import load_mesh

from .mesh_files import CORNERS, CUBE_OFF, QUADS, VERTICES_OBJ, as_bytes, glb, write

OFF_BODY = "\n".join([*CORNERS, *(f"4 {quad}" for quad in QUADS)]) + "\n"
OFF_COUNTS = "8 6 0\n"
RED = 0.299
FACES = [[int(corner) + 1 for corner in quad.split()] for quad in QUADS]
OBJ = VERTICES_OBJ + "".join("f " + " ".join(map(str, face)) + "\n" for face in FACES)
UV = "vt .2 .2\nvt .8 .2\nvt .2 .8\n"
TEXTURED = (
    UV
    + "usemtl m\n"
    + "".join("f " + " ".join(f"{corner}/{k % 3 + 1}" for k, corner in enumerate(face)) + "\n" for face in FACES)
)
XYZ = "property float x\nproperty float y\nproperty float z\n"
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
LIST = "property list uchar int vertex_indices\n"


def _ply(*, vertices: int = 8, kind: str = "ascii", of_vertices: str = "", of_faces: str = "") -> str:
    head = f"ply\nformat {kind} 1.0\nelement vertex {vertices}\n{XYZ}{of_vertices}"
    return f"{head}element face 6\n{LIST}{of_faces}end_header\n"


def _rows(corners: list[str], of_vertices: str = "", of_faces: str = "") -> str:
    return "\n".join([*(c + of_vertices for c in corners), *(f"4 {q}{of_faces}" for q in QUADS)]) + "\n"


def _binary_ply(order: str) -> bytes:
    head = _ply(kind=f"binary_{'little' if order == '<' else 'big'}_endian", of_faces=RGB)
    body = b"".join(struct.pack(f"{order}3f", *map(float, corner.split())) for corner in CORNERS)
    for quad in QUADS:
        body += struct.pack(f"{order}B4i3B", 4, *map(int, quad.split()), 255, 0, 0)
    return head.encode() + body + b"\n"


@pytest.mark.parametrize(
    ("name", "content", "brightness"),
    [
        ("glued.off", "OFF8 6 0\n" + OFF_BODY, 0.8),  # as ModelNet has it
        ("marked.off", "\ufeff" + CUBE_OFF, 0.8),
        ("without_keyword.off", OFF_COUNTS + OFF_BODY, 0.8),
        ("lower.off", "off\n" + OFF_COUNTS + OFF_BODY, 0.8),
        ("wide.off", CUBE_OFF.encode("utf-16"), 0.8),
        ("a_line_each.off", "OFF\n8\n6\n0\n" + OFF_BODY, 0.8),
        ("without_edges.off", "OFF # remark\n\n8 6\n" + OFF_BODY, 0.8),
        ("normals.off", "NOFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 0 0 1"), 0.8),
        ("both.off", "CNOFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 0 0 1 255 0 0 255"), RED),
        ("faces.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_faces=" 255 0 0"), RED),
        ("fractions.off", "OFF\r\n8 6 0\r\n" + _rows(CORNERS, of_faces=" 1.0 0.0 0.0 0.5"), RED),
        ("a_table.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_faces=" 3"), 0.8),
        ("tabs.obj", OBJ.replace(" ", "\t"), 0.8),
        ("indented.obj", "\r\n".join(f"  {line}\t# remark" for line in OBJ.splitlines()), 0.8),
        ("marked.obj", "\ufeff" + OBJ, 0.8),
        ("wide.obj", OBJ.encode("utf-16"), 0.8),
        ("old_mac.obj", OBJ.replace("\n", "\r"), 0.8),
        ("long_lines.obj", OBJ.replace("f 1", "f \\\n1"), 0.8),
        ("vertices.obj", OBJ.replace("\nf", " 1 0 0\nf", 1).replace("\nv", " 1 0 0\nv"), RED),
        ("with_uv.obj", "".join(f"v {corner} 1 0 0\n" for corner in CORNERS) + TEXTURED, RED),
        ("lost.obj", "mtllib none.mtl\n" + VERTICES_OBJ + TEXTURED, 0.8),
        ("depth.ply", _ply(vertices=9) + _rows([*CORNERS, "nan nan nan"]), 0.8),
        ("quads.ply", _ply(of_faces=RGB) + _rows(CORNERS, of_faces=" 255 0 0"), RED),
        ("little.ply", _binary_ply("<"), RED),
        ("big.ply", _binary_ply(">"), RED),
        ("vertices.ply", _ply(of_vertices=RGB) + _rows(CORNERS, of_vertices=" 255 0 0"), RED),
        ("behind.stl", as_bytes(trimesh.creation.box().export(file_type="stl")) + b"\r\n", 0.8),
    ],
)
def test_a_cube(tmp_path: Path, name: str, content: str | bytes, brightness: float) -> None:
    mesh = load_mesh(write(tmp_path, name, content))
    assert len(mesh.faces) == 12
    edges = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, :1]]
    areas = torch.linalg.cross(edges[:, 1], edges[:, 2]).norm(dim=1)
    torch.testing.assert_close(areas, torch.full_like(areas, 1 / 3))  # two of each square; the diagonal is 1
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, brightness))


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
def test_a_concave_face_covers_no_more_than_itself(tmp_path: Path, kind: str) -> None:
    dart = ["0 0 0", "2 1 0", "0 2 0", ".5 1 0"]
    head = f"ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}element face 1\n{LIST}end_header\n"
    text = {
        "obj": "".join(f"v {corner}\n" for corner in dart) + "f 1 2 3 4\n",
        "off": "OFF\n4 1 0\n" + "\n".join(dart) + "\n4 0 1 2 3\n",
        "ply": head + "\n".join(dart) + "\n4 0 1 2 3\n",
    }
    mesh = load_mesh(write(tmp_path, f"a.{kind}", text[kind]), up="z")
    edges = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, :1]]
    area = torch.linalg.cross(edges[:, 1], edges[:, 2]).norm(dim=1).sum() / 2
    assert float(area) == pytest.approx(1.5 / 8)  # the box is 2x2


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    "name",
    ["tex/w.png", "tex\\w.png", "-s 1 1 1 -clamp on tex/w.png", "C:\\Users\\me\\W.PNG", "/home/me/w.png", '"w.png"'],
)
def test_textures_by_names_of_other_machines(tmp_path: Path, name: str, bits: int) -> None:
    level = np.full((8, 8), 51 if bits == 8 else 13107, np.uint8 if bits == 8 else np.uint16)
    (tmp_path / "tex").mkdir()
    for folder in (tmp_path, tmp_path / "tex"):
        Image.fromarray(level).save(folder / "w.png")
    write(tmp_path, "a.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    mesh = load_mesh(write(tmp_path, "a.obj", "mtllib a.mtl\n" + VERTICES_OBJ + TEXTURED))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2))


def _scene(mode: int, indices: list[int], sparse: bool) -> tuple[dict[str, Any], bytes]:
    places = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]], "<f4")
    parts = [places.tobytes(), np.array(indices, "<u2").tobytes(), np.array([3, 0], "<u2").tobytes()]
    parts += [np.array([[4, 2, 0]], "<f4").tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    accessors: list[dict[str, Any]] = [
        {"componentType": 5126, "type": "VEC3", "count": 4, "bufferView": 0},
        {"componentType": 5123, "type": "SCALAR", "count": len(indices), "bufferView": 1},
    ]
    if sparse:
        at = {"bufferView": 2, "componentType": 5123}
        accessors[0]["sparse"] = {"count": 1, "indices": at, "values": {"bufferView": 3}}
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(part)} for start, part in zip(starts, parts, strict=False)
    ]
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": starts[-1]}],
    }
    return header, b"".join(parts)


@pytest.mark.parametrize(("mode", "indices"), [(4, [0, 1, 2, 1, 3, 2]), (5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])])
@pytest.mark.parametrize("sparse", [False, True])
def test_strips_fans_and_sparse_places(tmp_path: Path, mode: int, indices: list[int], sparse: bool) -> None:
    mesh = load_mesh(write(tmp_path, "a.glb", glb(*_scene(mode, indices, sparse))))
    edges = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, :1]]
    area = torch.linalg.cross(edges[:, 1], edges[:, 2]).norm(dim=1).sum() / 2
    # a rectangle of 2x1, or with its corner (2, 1) at (4, 2) a kite of twice the area
    assert float(area) == pytest.approx(4 / 20 if sparse else 2 / 5)


def test_extensions_that_change_what_numbers_mean_are_refused(tmp_path: Path) -> None:
    header, binary = _scene(4, [0, 1, 2], sparse=False)
    harmless = write(tmp_path, "a.glb", glb({**header, "extensionsRequired": ["KHR_materials_unlit"]}, binary))
    assert len(load_mesh(harmless).faces) == 1
    with pytest.raises(ValueError, match="EXT_unheard_of"):
        load_mesh(write(tmp_path, "b.glb", glb({**header, "extensionsRequired": ["EXT_unheard_of"]}, binary)))


_HALVES = np.full((8, 8), 255, np.uint8)  # a quarter of a texture is 51
_HALVES[4:, 4:] = 51
COLOURED: dict[str, tuple[list[tuple[str, NDArray[Any], int]], dict[str, Any]]] = {
    "colours of 16 bits": ([("COLOR_0", np.full((4, 4), 13107, "<u2"), 5123)], {}),
    "glossy": ([], {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.2, 0.2, 0.2, 1]}}}),
    "second places": (
        [("TEXCOORD_0", np.zeros((4, 2), "<f4"), 5126), ("TEXCOORD_1", np.full((4, 2), 204, np.uint8), 5121)],
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}},
    ),
    "moved": (
        [("TEXCOORD_0", np.tile(np.array([[0.1, 0.4]], "<f4"), (4, 1)), 5126)],
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {
                    "index": 0,
                    "extensions": {
                        "KHR_texture_transform": {"rotation": math.pi / 2, "scale": [1, 2], "offset": [0, 1]}
                    },
                }
            }
        },
    ),  # to (0.8, 0.9)
}


@pytest.mark.parametrize("name", COLOURED)
def test_colours_of_a_glb(tmp_path: Path, name: str) -> None:
    """Its texture is a file beside it, with a blank in its name."""
    header, binary = _scene(4, [0, 1, 2, 1, 3, 2], sparse=False)
    attributes, material = COLOURED[name]
    for key, numbers, kind in attributes:
        place = {"buffer": 0, "byteOffset": len(binary), "byteLength": numbers.nbytes}
        binary += numbers.tobytes()
        header["meshes"][0]["primitives"][0]["attributes"][key] = len(header["accessors"])
        shape = {"type": f"VEC{numbers.shape[1]}", "count": 4, "componentType": kind, "normalized": kind != 5126}
        header["accessors"].append({"bufferView": len(header["bufferViews"]), **shape})
        header["bufferViews"].append(place)
    if material:
        header["meshes"][0]["primitives"][0]["material"] = 0
        header |= {"materials": [material], "textures": [{"source": 0}], "images": [{"uri": "a%20b.png"}]}
        Image.fromarray(_HALVES).save(tmp_path / "a b.png")
    header["buffers"][0]["byteLength"] = len(binary)
    mesh = load_mesh(write(tmp_path, "a.glb", glb(header, binary)))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2), atol=0.002, rtol=0)


def test_instances_are_refused(tmp_path: Path) -> None:
    header, binary = _scene(4, [0, 1, 2], sparse=False)
    header["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {}}
    with pytest.raises(ValueError, match="EXT_mesh_gpu_instancing"):
        load_mesh(write(tmp_path, "a.glb", glb(header, binary)))


@pytest.mark.parametrize("libraries", ["mtllib a.mtl b c.mtl", "mtllib b c.mtl\nmtllib a.mtl", "mtllib none.mtl a.mtl"])
def test_several_libraries_of_materials(tmp_path: Path, libraries: str) -> None:
    write(tmp_path, "a.mtl", "newmtl m\nKd 0.2\n")
    write(tmp_path, "b c.mtl", "newmtl n\nKd 1 1 1\n")
    mesh = load_mesh(write(tmp_path, "a.obj", f"{libraries}\n{VERTICES_OBJ}usemtl m\nf 1 2 3\n"))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2))


@pytest.mark.parametrize("by", ["vertex", "corner"])
def test_textures_of_ply(tmp_path: Path, by: str) -> None:
    """A square whose lower left half is dark."""
    Image.fromarray(_HALVES[::-1, ::-1]).save(tmp_path / "t.png")  # the upper left quarter, at u < 1/2 < v
    places = ["0 1", "0.4 0.9", "0.2 0.6", "0.1 0.7"]
    corners = [f"{x} {y} 0" for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))]
    on_vertices = by == "vertex"
    text = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\n"
    text += "".join(f"property float {name}\n" for name in ("xyzst" if on_vertices else "xyz"))
    text += "element face 1\nproperty list uchar int vertex_indices\n"
    text += "end_header\n" if on_vertices else "property list uchar float texcoord\nend_header\n"
    lines = [f"{corner} {place}" if on_vertices else corner for corner, place in zip(corners, places, strict=True)]
    text += "\n".join([*lines, "4 0 1 2 3" + ("" if on_vertices else f" 8 {' '.join(places)}")])
    mesh = load_mesh(write(tmp_path, "a.ply", text))
    assert len(mesh.faces) == 2
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2))
