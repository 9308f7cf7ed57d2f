"""Files that are no mesh are refused in one sentence that says why."""

from __future__ import annotations

import os
import struct
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.exchange.stl import export_stl_ascii

from nablahog.render import mesh_bytes, mesh_file
from nablahog.render.mesh import load_mesh

from .mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, as_bytes, glb, triangle_glb, write


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
            load_mesh(write(tmp_path, name, CUBE_OFF))
    with pytest.raises(ValueError, match="no usual front"):
        load_mesh(write(tmp_path, "a.off", CUBE_OFF), up="x")


PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n"
)
BINARY_STL = as_bytes(trimesh.creation.box().export(file_type="stl"))
BINARY_PLY = as_bytes(trimesh.creation.box().export(file_type="ply"))
BAD_FACES = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
MANY = {"componentType": 5126, "type": "VEC3", "count": 2000}
FEW_FACES = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 0}]}]
DEEP = [{"mesh": 0, "children": [k + 1]} if k % 100 < 99 else {"mesh": 0} for k in range(10_000)]
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
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4 8"), "(outside the range|it does not hold)"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4 -1"), "(outside the range|it does not hold)"),
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
        ("a.glb", triangle_glb()[:-8], "truncated"),
        ("a.glb", triangle_glb(buffers=[{"byteLength": 36, "uri": "../secret.bin"}]), "needs the file"),
        ("a.glb", triangle_glb(extensionsRequired=["KHR_draco_mesh_compression"]), "not supported"),
        ("a.glb", triangle_glb(accessors=[{"componentType": 5126, "type": "VEC3", "count": 10**12}]), "at most"),
        ("a.glb", triangle_glb(bufferViews=[{"buffer": 0, "byteLength": 10**12}]), "at most"),
        ("a.glb", triangle_glb(nodes=[{"mesh": 0}] * 10_001), "at most 10,000 nodes"),
        ("a.glb", triangle_glb(nodes=[{"children": [1, 1]}, {"mesh": 0}]), "no tree"),
        ("a.glb", triangle_glb(nodes=[{"children": [1]}, {"mesh": 0, "children": [0]}]), "in a circle"),
        ("a.glb", triangle_glb(nodes=[{"mesh": 0, "scale": [float("nan"), 1, 1]}]), "not finite"),
        ("a.glb", triangle_glb(meshes=BAD_FACES, accessors=BAD_INDICES), "does not hold"),
        ("a.glb", triangle_glb(meshes=[]), "cannot be read"),
        (
            "a.glb",
            triangle_glb(nodes=[{"mesh": 0}] * 10_000, accessors=[MANY], meshes=FEW_FACES),
            "vertices in its nodes",
        ),
        ("a.glb", triangle_glb(meshes=FEW_FACES * 5_000, accessors=[MANY]), "5,000,000 vertices are allowed"),
        ("a.glb", triangle_glb(accessors=[MANY | {"type": "MAT4", "count": 10**7}]), "bytes in accessors are allowed"),
        (
            "a.glb",
            triangle_glb(bufferViews=[{"buffer": 0, "byteLength": 5 * 10**7}] * 2),
            "bytes in views are allowed",
        ),
        (
            "a.glb",
            triangle_glb(accessors=[MANY, MANY | {"count": -(10**12)}]),
            "count must be an integer of at least 0",
        ),
        ("a.glb", triangle_glb(accessors=[MANY | {"count": 1e9}]), "count must be an integer of at least 0"),
        ("a.glb", triangle_glb(nodes=DEEP), "nodes above others"),
        ("a.glb", triangle_glb(extras=[0] * 9_000_000), "its JSON has more than"),
        ("a.obj", TRIANGLE + "".join(f"usemtl {k}\nf 1 2 3\n" for k in range(10_000)), "at most 10,000 materials"),
        ("a.off", "OFF -1 -1 0\n0 0 0\n", "promises -1 vertices"),
        ("a.ply", PLY_HEAD.replace("face 2", f"face {10**9}"), "at most 20,000,000 rows"),
        ("a.ply", PLY_HEAD.replace("face 2", "face -2"), "promises -2 rows"),
        ("a.ply", "ply\n" + "comment x\n" * 200_000 + PLY_HEAD[4:], "its header has more than 1,048,576 bytes"),
        ("a.glb", glb([1, 2, 3]), "cannot be read"),
        ("a.glb", b"glTF" + struct.pack("<III", 2, 0, 99_999) + b"JSON" + b"[" * 99_999, "cannot be read"),
    ],
)
def test_damaged_files_are_refused_in_one_sentence(
    tmp_path: Path, name: str, content: str | bytes, reason: str
) -> None:
    path = write(tmp_path, name, content)
    with pytest.raises(ValueError, match=reason) as caught:
        load_mesh(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert "charset" not in message  # no parser may ask for what is not installed


def test_names_of_a_glb_are_not_repeated(tmp_path: Path) -> None:
    """trimesh would name each primitive of a node after the node."""
    primitives = [{"primitives": [{"attributes": {"POSITION": 0}}] * 1000}]
    node = {"mesh": 0, "name": "x" * 10**6, "camera": 0, "extras": {}}
    mesh = load_mesh(write(tmp_path, "a.glb", triangle_glb(meshes=primitives, nodes=[node], cameras=[{}])))
    assert (len(mesh.vertices), len(mesh.faces)) == (3, 1)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", TRIANGLE + "\n" * 80_000 + "f -1 -2 -3\n"),
        ("a.obj", TRIANGLE + "f 1 2 3" + " " * 80_000 + "\n"),
        ("a.off", "#\n" * 80_000 + "\n" * 80_000 + CUBE_OFF),
        ("a.stl", "solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n" * 4_000),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n20002 " + "0" * 4000 + " 1 2" + " 1" * 20_000 + "\n"),
    ],
)
def test_time_and_memory_grow_with_the_size(tmp_path: Path, name: str, content: str) -> None:
    path = write(tmp_path, name, content)
    tracemalloc.start()
    began = time.process_time()
    load_mesh(path)
    seconds, (_, most) = time.process_time() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert seconds < 4  # it took eight and more
    assert most < 100e6


def test_textures_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    box = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 5)))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    path = write(tmp_path, "a.glb", box.export(file_type="glb"))
    monkeypatch.setattr(mesh_file, "MAX_TEXELS", 20)
    assert load_mesh(path).brightness.max() == 0
    monkeypatch.setattr(mesh_file, "MAX_TEXELS", 19)
    with pytest.raises(ValueError, match="at most 19 texels are allowed, got 20"):
        load_mesh(path)


def test_a_whole_triangle_glb_is_read(tmp_path: Path) -> None:
    """What the refused ones above differ from."""
    mesh = load_mesh(write(tmp_path, "a.glb", triangle_glb()))
    assert (len(mesh.vertices), len(mesh.faces)) == (3, 1)


def test_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "a.off", CUBE_OFF)
    monkeypatch.setattr(mesh_file, "MAX_FACES", 11)
    with pytest.raises(ValueError, match="at most 11 faces are allowed, got 12"):
        load_mesh(path)
    monkeypatch.setattr(mesh_file, "MAX_BYTES", 100)
    with pytest.raises(ValueError, match="more than 100 bytes is refused"):
        load_mesh(path)
    assert mesh_bytes.MAX_FACES >= 1_000_000
