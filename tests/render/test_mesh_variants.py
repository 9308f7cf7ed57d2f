"""Mesh files as people's programs write them: a cube, and its brightness, in each of their ways."""

from __future__ import annotations

import base64
import io
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from trimesh.exchange.stl import export_stl_ascii

from nablahog.io.input_file import InputFile
from nablahog.render import load_mesh

from .mesh_files import CORNERS, CUBE_OFF, QUADS, VERTICES_OBJ, Glb, as_bytes, glb, surface_area, triangle_glb, write

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
STL = as_bytes(trimesh.creation.box().export(file_type="stl"))
FACETS = [STL[start : start + 48] for start in range(84, len(STL), 50)]
RED_STL = b"COLOR=\xff\0\0\xff".ljust(80) + STL[80:84] + b"".join(facet + b"\0\x80" for facet in FACETS)
STL_TEXT = export_stl_ascii(trimesh.creation.box())
LIST = "property list uchar int vertex_indices\n"


def _ply(*, vertices: int = 8, kind: str = "ascii", of_vertices: str = "", of_faces: str = "") -> str:
    head = f"ply\nformat {kind} 1.0\nelement vertex {vertices}\n{XYZ}{of_vertices}"
    return f"{head}element face 6\n{LIST}{of_faces}end_header\n"


def _rows(corners: list[str], of_vertices: str = "", of_faces: str = "") -> str:
    return "\n".join([*(c + of_vertices for c in corners), *(f"4 {q}{of_faces}" for q in QUADS)]) + "\n"


def _body(order: str, of_vertex: bytes, of_face: bytes) -> bytes:
    """The rows of a binary file."""
    vertices = (struct.pack(f"{order}3f", *map(float, corner.split())) + of_vertex for corner in CORNERS)
    faces = (struct.pack(f"{order}B4i", 4, *map(int, quad.split())) + of_face for quad in QUADS)
    return b"".join([*vertices, *faces, b"\n"])


def _binary_ply(order: str) -> bytes:
    head = _ply(kind=f"binary_{'little' if order == '<' else 'big'}_endian", of_faces=RGB)
    return head.encode() + _body(order, b"", b"\xff\0\0")


@pytest.mark.parametrize(
    ("name", "content", "brightness"),
    [
        ("glued.off", "OFF8 6 0\n" + OFF_BODY, 0.8),  # as ModelNet has it
        ("counts_beside.off", CUBE_OFF.replace("OFF\n", "OFF "), 0.8),
        ("latin.off", b"# si\xe8ge\n" + CUBE_OFF.encode(), 0.8),
        ("marked.off", "\ufeff" + CUBE_OFF, 0.8),
        ("without_keyword.off", OFF_COUNTS + OFF_BODY, 0.8),
        ("lower.off", "off\n" + OFF_COUNTS + OFF_BODY, 0.8),
        ("wide.off", CUBE_OFF.encode("utf-16"), 0.8),
        ("a_line_each.off", "OFF\n8\n6\n0\n" + OFF_BODY, 0.8),
        ("without_edges.off", "OFF # remark\n\n8 6\n" + OFF_BODY, 0.8),
        ("normals.off", "NOFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 0 0 1"), 0.8),
        ("both.off", "CNOFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 0 0 1 255 0 0 255"), RED),
        ("colours.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 51 51 51"), 0.2),
        ("directions.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 0 -1 0"), 0.8),  # no colours
        ("faces.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_faces=" 255 0 0"), RED),
        ("fractions.off", "OFF\r\n8 6 0\r\n" + _rows(CORNERS, of_faces=" 1.0 0.0 0.0 0.5"), RED),
        ("a_table.off", "OFF\n8 6 0\n" + _rows(CORNERS, of_faces=" 3"), 0.8),
        ("dark.off", "COFF\n8 6 0\n" + _rows(CORNERS, of_vertices=" 1 1 1 255"), 1 / 255),  # the alpha tells 255 from 1
        ("without_corners.off", CUBE_OFF.replace("8 6 0", "8 7 0") + "0\n", 0.8),
        ("tabs.obj", OBJ.replace(" ", "\t"), 0.8),
        ("indented.obj", "\r\n".join(f"  {line}\t# remark" for line in OBJ.splitlines()), 0.8),
        ("marked.obj", "\ufeff" + OBJ, 0.8),
        ("wide.obj", OBJ.encode("utf-16"), 0.8),
        ("old_mac.obj", OBJ.replace("\n", "\r"), 0.8),
        ("long_lines.obj", OBJ.replace("f 1", "f \\\n1"), 0.8),
        ("vertices.obj", OBJ.replace("\nf", " 1 0 0\nf", 1).replace("\nv", " 1 0 0\nv"), RED),
        ("with_uv.obj", "".join(f"v {corner} 1 0 0\n" for corner in CORNERS) + TEXTURED, RED),
        ("remark.obj", "# C:\\models\\\n" + OBJ, 0.8),  # whose last character continues no line
        ("old_word.obj", OBJ.replace("f ", "fo "), 0.8),
        ("old_windows.obj", OBJ.replace("f", "v -1.#IND -1.#IND -nan(ind)\nf", 1), 0.8),
        ("levels.obj", "".join(f"v {corner} 255 0 0\n" for corner in CORNERS) + OBJ[len(VERTICES_OBJ) :], RED),
        ("one_coloured.obj", OBJ.replace("v 0 0 0\n", "v 0 0 0 1 0 0\n"), 0.8),
        ("one_place.obj", VERTICES_OBJ + "vt .5\n" + TEXTURED[len(UV) :].replace("/2", "/1").replace("/3", "/1"), 0.8),
        ("mixed.obj", OBJ.replace("f 1 2 3 4", "vt 0 0\nvn 0 0 1\nf 1//1 2/1 3/1/1 -5"), 0.8),
        ("lost.obj", "mtllib none.mtl\n" + VERTICES_OBJ + TEXTURED, 0.8),
        ("depth.ply", _ply(vertices=9) + _rows([*CORNERS, "nan nan nan"]), 0.8),
        ("quads.ply", _ply(of_faces=RGB) + _rows(CORNERS, of_faces=" 255 0 0"), RED),
        ("without_corners.ply", _ply().replace("face 6", "face 7") + _rows(CORNERS) + "0\n", 0.8),
        ("without_corners.ply", _binary_ply("<").replace(b"face 6", b"face 7")[:-1] + b"\0\xff\0\0", RED),
        ("without_rows.ply", _ply().replace("end_", f"element edge 0\n{XYZ}end_") + _rows(CORNERS), 0.8),
        ("little.ply", _binary_ply("<"), RED),
        ("big.ply", _binary_ply(">"), RED),
        ("vertices.ply", _ply(of_vertices=RGB) + _rows(CORNERS, of_vertices=" 255 0 0"), RED),
        ("old_mac.ply", (_ply() + _rows(CORNERS)).replace("\n", "\r"), 0.8),
        ("wide.ply", (_ply() + _rows(CORNERS)).encode("utf-16"), 0.8),
        ("remarks.ply", (_ply() + _rows(CORNERS)).replace("element", "comment to end_header\nelement", 1), 0.8),
        ("old_windows.ply", _ply(vertices=9) + _rows([*CORNERS, "-nan(ind) -1.#IND 0"]), 0.8),
        ("levels.ply", _ply(of_vertices=RGB.replace("uchar", "float")) + _rows(CORNERS, of_vertices=" 255 0 0"), RED),
        ("wider.ply", _ply(of_vertices=RGB.replace("uchar", "int")) + _rows(CORNERS, of_vertices=" 255 0 0"), RED),
        ("capitals.ply", _ply(of_vertices=RGB.replace("red", "Red")) + _rows(CORNERS, of_vertices=" 255 0 0"), RED),
        ("behind.stl", STL + b"\r\n", 0.8),
        ("coloured.stl", RED_STL, RED),
        ("old_mac.stl", STL_TEXT.replace("\n", "\r"), 0.8),
        ("one_line.stl", "\n" + " ".join(STL_TEXT.split()), 0.8),
    ],
)
def test_a_cube(tmp_path: Path, name: str, content: str | bytes, brightness: float) -> None:
    mesh = load_mesh(write(tmp_path, name, content))
    assert len(mesh.faces) == 12
    edges = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, :1]]
    areas = torch.linalg.cross(edges[:, 1], edges[:, 2]).norm(dim=1)
    torch.testing.assert_close(areas, torch.full_like(areas, 1 / 3))  # two of each square; the diagonal is 1
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, brightness))


@pytest.mark.parametrize("kind", ["obj", "textured.ply"])
def test_a_concave_face_covers_no_more_than_itself(tmp_path: Path, kind: str) -> None:
    dart = ["0 0 0", "2 1 0", "0 2 0", ".5 1 0"]
    head = f"ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}element face 1\n{LIST}end_header\n"
    head = head.replace("element", "comment TextureFile none.png\nelement", 1)
    text = {
        "obj": "".join(f"v {corner}\n" for corner in dart) + "f 1 2 3 4\n",
        "textured.ply": head + "\n".join(dart) + "\n4 0 1 2 3\n",
    }
    mesh = load_mesh(write(tmp_path, f"a.{kind}", text[kind]), up="z")
    assert surface_area(mesh) == pytest.approx(1.5 / 8)  # the box is 2x2


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    "name",
    [
        "tex/w.png",
        "tex\\w.png",
        "-s 1 1 1 -clamp on tex/w.png",
        "C:\\Users\\me\\W.PNG",
        "/home/me/w.png",
        '"w.png"',
        "/home/me/tex/w.png",
        "a%20w.png",
        "../images/w.png",
    ],
)
def test_textures_by_names_of_other_machines(tmp_path: Path, name: str, bits: int) -> None:
    level = np.full((8, 8), 51 if bits == 8 else 13107, np.uint8 if bits == 8 else np.uint16)
    models = tmp_path / "models"
    for file in ("models/w.png", "models/a w.png", "models/tex/w.png", "images/w.png"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        Image.fromarray(level).save(tmp_path / file)
    write(models, "a.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    mesh = load_mesh(write(models, "a.obj", "mtllib a.mtl\n" + VERTICES_OBJ + TEXTURED))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2))


@pytest.mark.parametrize("colour", ["0.4", "0,4 0,4 0,4", ".4\t.4\t.4 # gray"])
@pytest.mark.parametrize("names", ["a.mtl my b.mtl", "none.mtl\nmtllib my b.mtl # gray", "my b.mtl"])
def test_materials_in_any_of_the_files_that_are_named(tmp_path: Path, names: str, colour: str) -> None:
    write(tmp_path, "a.mtl", "newmtl other\nKd 1 1 1\n")
    write(tmp_path, "my b.mtl", f"newmtl Material #25\nKd {colour}\n")
    text = OBJ.replace("f", "usemtl Material #25 # gray\nf", 1)
    mesh = load_mesh(write(tmp_path, "a.obj", f"mtllib {names}\n{text}"))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.4))


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("by_face", [True, False])
@pytest.mark.parametrize("binary", [True, False])
def test_a_textured_ply(tmp_path: Path, there: bool, by_face: bool, binary: bool) -> None:
    """Without the texture, its colours remain."""
    if there:
        Image.fromarray(np.full((8, 8), 51, np.uint8)).save(tmp_path / "a w.png")
    places = "" if by_face else "property float s\nproperty float t\n"
    head = _ply(
        kind="binary_little_endian" if binary else "ascii",
        of_vertices=RGB + places,
        of_faces="property list uchar float texcoord\n" if by_face else "",
    ).replace("element", "comment TextureFile a w.png\nelement", 1)
    if binary:
        of_vertex = b"\xff\0\0" + struct.pack("<2f", 0.3, 0.3) * (not by_face)
        body = _body("<", of_vertex, struct.pack("<B8f", 8, *[0.3] * 8) * by_face)
    else:
        body = _rows(CORNERS, " 255 0 0" + " .3 .3" * (not by_face), (" 8" + " .3" * 8) * by_face).encode()
    content = head.encode() + body
    mesh = load_mesh(write(tmp_path, "a.ply", content))
    assert len(mesh.faces) == 12
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2 if there else RED))


@pytest.mark.parametrize("kind", ["obj", "glb", "gltf"])
@pytest.mark.parametrize("name", ["capsule", "cone", "torus", "annulus", "axis"])
def test_scenes_of_another_program(tmp_path: Path, name: str, kind: str) -> None:
    """Two shapes, one of them moved, stretched and mirrored: as many squares and as dark as trimesh has them."""
    sizes = {"cone": (1, 2), "torus": (2, 0.5), "annulus": (1, 2, 1)}
    shape = getattr(trimesh.creation, name)(*sizes.get(name, ()))
    colours = np.tile(np.array([200, 100, 50, 255], np.uint8), (len(shape.vertices), 1))
    shape.visual = trimesh.visual.ColorVisuals(shape, vertex_colors=colours)
    scene = trimesh.Scene([shape])
    place = trimesh.transformations.compose_matrix(scale=(-1, 2, 1), angles=(0.3, 0.2, 0.1), translate=(3, 1, 2))
    scene.add_geometry(shape, transform=place)
    exported = scene.export(file_type=kind)
    for file, content in (exported if kind == "gltf" else {f"model.{kind}": as_bytes(exported)}).items():
        write(tmp_path, file, content)
    mesh, expected = load_mesh(tmp_path / f"model.{kind}", up="z", front="-y"), scene.to_mesh()
    expected.apply_translation(-expected.bounds.mean(axis=0))
    expected.apply_scale(1 / expected.scale)
    triangles = trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False)
    assert triangles.area == pytest.approx(expected.area, rel=1e-4)
    np.testing.assert_allclose(triangles.centroid, expected.centroid, atol=1e-4)
    gray = torch.full_like(mesh.brightness, float(colours[0, :3] @ [0.299, 0.587, 0.114]) / 255)
    torch.testing.assert_close(mesh.brightness, gray, atol=2e-3, rtol=0)


def _rectangle(mode: int = 4, indices: Sequence[int] = (0, 1, 2, 1, 3, 2), sparse: bool = False) -> Glb:
    """Of 2x1; with ``sparse`` its last corner is not at (2, 1), but at (4, 2)."""
    model = Glb([[0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]], mode=mode)
    model.primitive["indices"] = model.add(np.array(indices, "<u2")[:, None])
    if sparse:
        at = {"bufferView": model.view(np.array([3], "<u2")), "componentType": 5123}
        moved = {"bufferView": model.view(np.array([[4, 2, 0]], "<f4"))}
        model.header["accessors"][0]["sparse"] = {"count": 1, "indices": at, "values": moved}
    return model


@pytest.mark.parametrize(("mode", "indices"), [(4, [0, 1, 2, 1, 3, 2]), (5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])])
@pytest.mark.parametrize("sparse", [False, True])
def test_strips_fans_and_sparse_places(tmp_path: Path, mode: int, indices: list[int], sparse: bool) -> None:
    mesh = load_mesh(write(tmp_path, "a.glb", _rectangle(mode, indices, sparse).data()))
    # a rectangle of 2x1, or with its corner (2, 1) at (4, 2) a kite of twice the area
    assert surface_area(mesh) == pytest.approx(4 / 20 if sparse else 2 / 5)


def test_extensions_that_change_what_numbers_mean_are_refused(tmp_path: Path) -> None:
    harmless = write(tmp_path, "a.glb", triangle_glb(extensionsRequired=["KHR_materials_unlit"]))
    assert len(load_mesh(harmless).faces) == 1
    with pytest.raises(ValueError, match="EXT_unheard_of"):
        load_mesh(write(tmp_path, "b.glb", triangle_glb(extensionsRequired=["EXT_unheard_of"])))


WHITE_BELOW = [[0] * 4] * 2 + [[255] * 4] * 2  # of a texture, whose first row is v = 0


@pytest.mark.parametrize(
    ("texture", "sets", "kind", "brightness"),
    [
        ({}, [0.2], "<f4", 0),
        ({}, [0.8], "<u2", 1),  # integers stand for fractions
        ({}, [0.8], "<u1", 1),
        ({"texCoord": 1}, [0.2, 0.8], "<f4", 1),
        ({"extensions": {"KHR_texture_transform": {"offset": [0, 0.5]}}}, [0.2], "<u2", 1),
        ({"extensions": {"KHR_texture_transform": {"rotation": -np.pi / 2}}}, [0.2], "<f4", 1),  # (u, v) to (-v, u)
        ({"extensions": {"KHR_texture_transform": {"texCoord": 1, "scale": [1, 0.25]}}}, [0.2, 0.8], "<f4", 0),
        ({"texCoord": 1}, [0.2], "<f4", 0.8),  # which is not there
        ({"index": 1}, [0.8], "<f4", 1),
        ({"index": 2}, [0.2], "<f4", 0.8),
    ],
)
@pytest.mark.parametrize("inside", [True, False])
def test_places_in_the_texture_of_a_glb(
    tmp_path: Path, texture: dict[str, Any], sets: list[float], kind: str, brightness: float, inside: bool
) -> None:
    model, file = _rectangle(), io.BytesIO()
    Image.fromarray(np.array(WHITE_BELOW, np.uint8)).save(tmp_path / "w.png")
    Image.fromarray(np.array(WHITE_BELOW, np.uint8)).save(file, "PNG")
    model.primitive["material"] = 0
    scale = 1 if kind == "<f4" else np.iinfo(kind).max
    for number, v in enumerate(sets):
        places = np.tile(np.array([0.7, v]) * scale, (4, 1)).astype(kind)
        model.primitive["attributes"][f"TEXCOORD_{number}"] = model.add(places, normalized=kind != "<f4")
    url = "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()
    content = model.data(
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}}}],
        textures=[
            {"source": 0},
            {"extensions": {"EXT_texture_webp": {"source": 0}}},
            {"extensions": {"KHR_texture_basisu": {"source": 0}}},  # of a format that is not read
        ],
        images=[{"uri": url if inside else "w.png"}],
        extensionsRequired=["KHR_texture_transform", "KHR_mesh_quantization"],
    )
    mesh = load_mesh(write(tmp_path, "a.glb", content))
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, brightness))


def _skinned(joints: list[list[int]], weights: list[list[float]]) -> bytes:
    """A rectangle with two joints, of which the second is 2 higher."""
    model = _rectangle()
    model.primitive["attributes"] |= {
        "JOINTS_0": model.add(np.array(joints, "u1")),
        "WEIGHTS_0": model.add(np.array(weights, "<f4")),
    }
    return model.data(
        scenes=[{"nodes": [0, 1, 2]}],
        nodes=[{"mesh": 0, "skin": 0, "scale": [1, 9, 1]}, {}, {"translation": [0, 2, 0]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": model.add(np.array([np.eye(4)] * 2, "<f4"))}],
    )


WEIGHTS = [[1.0, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]]


@pytest.mark.parametrize(("corners", "weighted"), [(3, 4), (4, 3)])
def test_a_skeleton_of_other_corners_is_refused(tmp_path: Path, corners: int, weighted: int) -> None:
    content = _skinned([[0, 1, 0, 0]] * corners, WEIGHTS[:weighted])
    with pytest.raises(ValueError, match="not as many joints as vertices"):
        load_mesh(write(tmp_path, "a.glb", content))


def test_a_skeleton_moves_the_mesh_instead_of_its_node(tmp_path: Path) -> None:
    """The corners follow two joints: of one they keep their place, of the other they move by 2 y, half each by 1 y."""
    mesh = load_mesh(write(tmp_path, "a.glb", _skinned([[0, 1, 0, 0]] * 4, WEIGHTS)))
    corners = mesh.vertices[:, [0, 2]] * 13**0.5 + torch.tensor([1.0, 1.5], dtype=torch.float64)
    expected = torch.tensor([[0, 0], [2, 0], [0, 2], [2, 3]], dtype=torch.float64)
    assert float(torch.cdist(corners, expected).amin(0).max()) < 1e-6


@pytest.mark.parametrize("kind", ["off", "obj", "glb"])
def test_bytes_are_read_as_a_file_that_has_none_beside_it(tmp_path: Path, kind: str) -> None:
    contents = {"off": CUBE_OFF.encode(), "obj": b"mtllib a.mtl\nusemtl m\n" + OBJ.encode(), "glb": triangle_glb()}
    write(tmp_path, "a.mtl", "newmtl m\nKd 0 0 0\n")
    mesh = load_mesh(InputFile(str(tmp_path / f"a.{kind}"), contents[kind]))
    assert len(mesh.faces) == (1 if kind == "glb" else 12)
    assert bool((mesh.brightness == 0.8).all())
    with pytest.raises(ValueError, match=f"^my.{kind}: "):
        load_mesh(InputFile(f"my.{kind}", b"nothing"))


def test_older_materials_and_buffers_of_a_glb(tmp_path: Path) -> None:
    model = _rectangle(6, [0, 1, 3, 2], sparse=True)
    model.primitive["material"] = 0
    older = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.2, 0.2, 0.2, 1]}}
    url = "data:application/octet-stream;base64," + base64.b64encode(model.binary).decode()
    buffers = [{"byteLength": len(model.binary), "uri": url}]
    header = model.header | {"scenes": None, "materials": [{"extensions": older}], "buffers": buffers}
    mesh = load_mesh(write(tmp_path, "a.glb", glb(header)))
    assert len(mesh.faces) == 2
    torch.testing.assert_close(mesh.brightness, torch.full_like(mesh.brightness, 0.2))
