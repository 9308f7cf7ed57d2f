"""Files that are no mesh are refused in one sentence that says why."""

from __future__ import annotations

import base64
import re
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.exchange.stl import export_stl_ascii

from nablahog.render import companion_files, gltf_checks, mesh_file, obj_file, soup
from nablahog.render.mesh import load_mesh

from .mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, Glb, as_bytes, glb, triangle_glb, write


def test_unknown_endings_and_axes(tmp_path: Path) -> None:
    for name in ("a.dae", "a.zip", "a"):
        with pytest.raises(
            ValueError, match=r"expected a mesh file \(.off, .obj, .ply, .stl, .glb, .gltf\), got the ending"
        ):
            load_mesh(write(tmp_path, name, CUBE_OFF))
    with pytest.raises(ValueError, match="no usual front"):
        load_mesh(write(tmp_path, "a.off", CUBE_OFF), up="x")


PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n"
)
BINARY_STL = as_bytes(trimesh.creation.box().export(file_type="stl"))
BINARY_PLY = as_bytes(trimesh.creation.box().export(file_type="ply"))
MANY = {"componentType": 5126, "type": "VEC3", "count": 2000}
UNREAD = ("EXT_mesh_gpu_instancing", "EXT_meshopt_compression")
FEW_FACES = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 0}]}]


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        *((f"noise.{kind}", bytes(range(256)) * 4, "cannot be read") for kind in ("off", "obj", "ply", "stl", "glb")),
        ("a.off", CUBE_OFF[:-11], r"promises 8 \+ 6 lines"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4 -1"), "(outside the range|the file does not hold)"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1 nan 1"), "not finite"),
        ("a.off", "OFF 3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", "area above 0"),
        ("a.off", "OFF 3 1 0\n0 0\n1 0\n1 1\n3 0 1 0\n", "three coordinates each"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "4 3 0 4"), "a face of 4 vertex indices, got 3"),
        ("a.off", CUBE_OFF.replace("4 3 0 4 7", "-1 3 0 4 7"), "a face of -1 vertex indices"),
        ("a.off", "COFF 3 1 0\n0 0 0 1 0 0\n1 0 0 1 0 0\n1 1 0 1 0\n3 0 1 2\n", "a colour of three numbers each"),
        ("a.obj", VERTICES_OBJ + "l 1 2 3\n", "no faces"),
        ("a.obj", VERTICES_OBJ + "f 1 2 -9\n", "refers to -9"),
        ("a.obj", TRIANGLE + "".join(f"usemtl {k}\nf 1 2 3\n" for k in range(10_000)), "at most 10,000 materials"),
        ("a.ply", PLY_HEAD + "3 0 1 2\n", "element face than it promises: 2"),
        ("a.ply", PLY_HEAD.replace("face 2", f"face {10**9}"), "at most 20,000,000 rows"),
        ("a.ply", PLY_HEAD.replace("list uchar int", "int") + "0\n1\n", "a list vertex_indices in the element face"),
        ("a.ply", PLY_HEAD.replace("vertex 3", "vertex -3"), "promises -3 rows of the element vertex"),
        ("a.ply", PLY_HEAD.replace("face 2", "vertex 2") + "3 0 1 2\n" * 2, "the element vertex twice"),
        ("a.ply", PLY_HEAD.replace("property float z\n", "") + "3 0 1 2\n" * 2, "three coordinates each"),
        *(("a.ply", PLY_HEAD + f"3 0 1 2\n{row}\n", "face has too few numbers") for row in ("3 0 1", "-1 0 1")),
        ("a.ply", PLY_HEAD.replace("property list", "property int a\nproperty list") + "3\n" * 2, "too few numbers"),
        ("a.ply", BINARY_PLY[:-5], "cannot be read"),
        ("a.ply", BINARY_PLY.replace(b"list uchar", b"list char ")[:-13] + b"\xff" * 13, "a list of -1 numbers"),
        ("a.stl", BINARY_STL[:-5], "length that it promises"),
        ("a.stl", export_stl_ascii(trimesh.creation.box())[:700], "from solid to endsolid"),
        ("a.off", "OFF\n", "the numbers of vertices and faces are missing"),
        ("a.off", "4OFF\n" + CUBE_OFF[4:], "three coordinates a vertex"),
        ("a.off", CUBE_OFF.replace("1 1 1", "1,5 1 1"), "got '1,5'"),
        ("a.off", CUBE_OFF.replace("1 1 1", "x" * 3000 + " 1 1"), "expected a number"),
        ("a.obj", TRIANGLE.replace("2 0 0", "2,5 0 0"), "numbers"),
        ("a.obj", TRIANGLE + "f 1 2 9\n", "the file does not hold"),
        ("a.obj", TRIANGLE + "f 0 1 2\n", "the file does not hold"),
        ("a.obj", TRIANGLE + "f 1 2 3.0\n", "expected faces such as"),
        ("a.obj", TRIANGLE + "v 1 2\n", "at least 3 numbers"),
        ("a.obj", TRIANGLE + "f 1 2 /3\n", "expected faces such as"),
        ("a.gltf", TRIANGLE, "as JSON does"),
        ("a.gltf", '{"nodes": [}', "its JSON is damaged: Expecting value"),
        ("a.ply", PLY_HEAD.replace("face 2", "tristrips 1") + "3 0 1 2\n", "got the elements vertex, tristrips"),
        ("a.ply", PLY_HEAD.replace("float x", "half x"), "type half"),
        ("a.stl", export_stl_ascii(trimesh.creation.box()).replace("0.5", "0,5"), "decimal points"),
        ("a.stl", export_stl_ascii(trimesh.creation.box()).replace("vertex", "vert", 3), "three corners"),
        ("a.glb", triangle_glb()[:-8], "truncated"),
        *(("a.glb", triangle_glb(extensionsUsed=[name]), "not supported") for name in UNREAD),
        ("a.glb", triangle_glb(nodes=[{"mesh": 0, "weights": [0.5]}]), "morph targets"),
        ("a.glb", triangle_glb(buffers=[{"byteLength": 36, "uri": "../secret.bin"}]), "needs the file"),
        ("a.glb", triangle_glb(extensionsRequired=["KHR_draco_mesh_compression"]), "not supported"),
        ("a.glb", triangle_glb(nodes=[{"mesh": 0}] * 10_001), "at most 10,000 nodes"),
        ("a.glb", triangle_glb(nodes=[{"children": [1]}, {"mesh": 0, "children": [0]}]), "in a circle"),
        ("a.glb", triangle_glb(nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}]), "one has two parents"),
        ("a.glb", triangle_glb(buffers=[{"byteLength": 36}] * 2), "more than one buffer"),
        *(("a.glb", triangle_glb(accessors=[MANY | {"type": kind}]), "three coordinates") for kind in ("VEC2", "VEC4")),
        ("a.glb", triangle_glb(meshes=FEW_FACES * 5_000, accessors=[MANY]), "5,000,000 vertices are allowed"),
        ("a.glb", triangle_glb(accessors=[MANY | {"type": "MAT4", "count": 10**7}]), "bytes in accessors are allowed"),
        ("a.glb", triangle_glb(accessors=[MANY | {"count": 1e9}]), "count must be an integer of at least 0"),
        ("a.glb", triangle_glb(extras=[0] * 9_000_000), "its JSON has more than"),
        ("a.glb", triangle_glb(meshes=[{"primitives": [{"attributes": {}}]}]), "it has no 'POSITION'"),
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
    assert len(message) < 1000
    assert "charset" not in message  # no parser may ask for what is not installed


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", TRIANGLE + "\n" * 2_000_000 + "f -1 -2 -3\n"),
        ("a.stl", "solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n" * 4_000),
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


def test_rows_that_are_missing_are_noticed_at_once(tmp_path: Path) -> None:
    head = BINARY_PLY[: BINARY_PLY.index(b"end_header\n") + 11].replace(b"vertex 8", b"vertex 10000")
    path = write(tmp_path, "a.ply", head + bytes(12 * 10_000 - 1))
    tracemalloc.start()
    with pytest.raises(ValueError, match="fewer rows of the element vertex than it promises: 10,000"):
        load_mesh(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1e6  # row by row, it would be several


def test_textures_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    box = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 5)))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    path = write(tmp_path, "a.glb", box.export(file_type="glb"))
    monkeypatch.setattr(companion_files, "MAX_TEXELS", 20)
    assert load_mesh(path).brightness.max() == 0
    monkeypatch.setattr(companion_files, "MAX_TEXELS", 19)
    with pytest.raises(ValueError, match="at most 19 texels are allowed, got 20"):
        load_mesh(path)


def test_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "a.off", CUBE_OFF)
    monkeypatch.setattr(mesh_file, "MAX_FACES", 11)
    with pytest.raises(ValueError, match="at most 11 faces are allowed, got 12"):
        load_mesh(path)
    with pytest.raises(ValueError, match="at most 11 faces are allowed, got 12"):  # before its numbers are read
        load_mesh(write(tmp_path, "a.stl", "solid" + " vertex" * 36))
    monkeypatch.setattr(mesh_file, "MAX_FACES", 12)
    assert len(load_mesh(write(tmp_path, "b.stl", BINARY_STL)).faces) == 12
    monkeypatch.setattr(obj_file, "MAX_FACES", 1)
    with pytest.raises(ValueError, match="at most 1 faces are allowed, got 2"):
        load_mesh(write(tmp_path, "a.obj", TRIANGLE + "f 1 2 3\n"))
    assert load_mesh(write(tmp_path, "a.obj", TRIANGLE)).faces.shape == (1, 3)
    nested = triangle_glb(nodes=[{"mesh": 0, "children": [1]}, {"children": [2]}, {}])
    monkeypatch.setattr(gltf_checks, "MAX_LEVELS", 3)
    load_mesh(write(tmp_path, "a.glb", nested))
    monkeypatch.setattr(gltf_checks, "MAX_LEVELS", 2)
    with pytest.raises(ValueError, match="at most 2 ancestors are allowed"):
        load_mesh(write(tmp_path, "a.glb", nested))
    monkeypatch.setattr(mesh_file, "MAX_MESH_BYTES", 100)
    with pytest.raises(ValueError, match="more than 100 bytes is refused"):
        load_mesh(path)
    assert soup.MAX_FACES >= 1_000_000


def test_a_file_beside_it_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]], "<f4").tobytes()
    path = write(tmp_path, "a.glb", triangle_glb(buffers=[{"byteLength": 36, "uri": "./a.bin"}]))
    write(tmp_path, "a.bin", corners)
    for limit, most, reason in (
        ("LONGEST_NAME", 7, "the name of a file has more than 6 characters"),
        ("MAX_BYTES_BESIDE", 36, "the files that it needs have more than 35 bytes"),
    ):
        with monkeypatch.context() as lowered:
            lowered.setattr(companion_files, limit, most)
            assert len(load_mesh(path).faces) == 1
            lowered.setattr(companion_files, limit, most - 1)
            with pytest.raises(ValueError, match=f"it needs the file './a.bin', but {reason}; save the model as GLB"):
                load_mesh(path)


# --- what glTF does not allow in its JSON, and buffers that are not there, by name and place --------------------------

ACCESSOR = {"componentType": 5126, "type": "VEC3", "bufferView": 0, "count": 3}
VIEW = {"buffer": 0, "byteLength": 36}
TOO_SHORT = "the buffer is missing or shorter than byteLength says"
INTERNALS = re.compile("' object|has no attribute|out of range|recursion|digits")


def _sparse(*indices: int) -> dict[str, Any]:
    """A file whose sparse corners, at indices of one signed byte, are the first."""
    model = Glb([[0, 0, 0], [2, 0, 0], [0, 1, 0]])
    at = {"bufferView": model.view(np.array(indices, "i1")), "componentType": 5120}
    model.header["accessors"][0]["sparse"] = {"count": len(indices), "indices": at, "values": {"bufferView": 0}}
    url = "data:;base64," + base64.b64encode(model.binary).decode()
    return {**model.header, "buffers": [{"byteLength": len(model.binary), "uri": url}]}


def _mesh(**primitive: Any) -> list[dict[str, Any]]:
    return [{"primitives": [primitive]}]


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"nodes": [{"mesh": -1}]}, "nodes[0].mesh must be an index below 1, the number of meshes, got -1"),
        ({"nodes": [{"mesh": "0"}]}, "nodes[0].mesh must be an index below 1, the number of meshes, got '0'"),
        ({"nodes": [{"mesh": True}]}, "nodes[0].mesh"),
        ({"nodes": [{"mesh": 0, "scale": 2}]}, "nodes[0].scale"),
        ({"nodes": [{"mesh": 0, "matrix": [1] * 15}]}, "nodes[0].matrix"),
        ({"nodes": [{"mesh": 0, "translation": [0, 10**400, 0]}]}, "nodes[0].translation[1]"),
        ({"nodes": [{"mesh": 0, "children": [-1]}]}, "nodes[0].children[0]"),
        ({"nodes": [5]}, "nodes[0]"),
        ({"meshes": []}, "nodes[0].mesh"),
        ({"meshes": 5}, "meshes"),
        ({"meshes": _mesh(attributes={"POSITION": -1})}, "meshes[0].primitives[0].attributes.POSITION"),
        ({"meshes": _mesh(attributes={"POSITION": 0}, indices=1)}, "meshes[0].primitives[0].indices"),
        ({"scene": -1}, "scene"),
        ({"scenes": [{"nodes": [-1]}]}, "scenes[0].nodes[0]"),
        ({"bufferViews": [VIEW | {"byteOffset": -4}]}, "bufferViews[0].byteOffset"),
        ({"bufferViews": [VIEW | {"byteStride": 0}]}, "bufferViews[0].byteStride"),
        ({"bufferViews": [VIEW | {"byteLength": 35}]}, "bufferViews[0].byteLength"),
        ({"bufferViews": [VIEW | {"byteLength": 40}]}, f"buffers[0]: {TOO_SHORT}: it has 36 of 40 bytes"),
        ({"bufferViews": [{"byteLength": 36}], "buffers": []}, f"buffers[0]: {TOO_SHORT}: it has 0 of 36 bytes"),
        ({"accessors": [ACCESSOR | {"byteOffset": -12}]}, "accessors[0].byteOffset"),
        ({"accessors": [ACCESSOR | {"bufferView": -1}]}, "accessors[0].bufferView"),
        ({"accessors": [ACCESSOR | {"componentType": 1}]}, "accessors[0].componentType"),
        ({"accessors": [ACCESSOR | {"componentType": []}]}, "accessors[0].componentType"),
        ({"accessors": [ACCESSOR | {"type": {}}]}, "accessors[0].type"),
        ({"buffers": [{"byteLength": 36, "uri": 5}]}, "buffers[0].uri"),
        ({"buffers": [{"byteLength": 40}]}, f"buffers[0]: {TOO_SHORT}: it has 36 of 40 bytes"),
        *(
            ({"buffers": [{"byteLength": 36, "uri": uri}]}, f"buffers[0]: {TOO_SHORT}: it has 0 of 36 bytes")
            for uri in ("data:", "data:;base64,@@@", "data:;base64,AAAAA", "data:;base64,ä")
        ),
        (_sparse(-1), "accessors[0].sparse.indices"),
        (_sparse(3), "accessors[0].sparse.indices"),
        (_sparse(0, 1, 2, 2), "accessors[0].sparse.count must be at most 3, got 4"),
    ],
)
def test_the_place_of_what_is_wrong_is_named(tmp_path: Path, changes: dict[str, Any], place: str) -> None:
    with pytest.raises(ValueError, match=re.escape(place)) as caught:
        load_mesh(write(tmp_path, "a.glb", triangle_glb(**changes)))
    reason = str(caught.value).partition("cannot be read: ")[2]
    assert reason.removeprefix("the numbers of ").startswith(place)


def test_what_is_no_header_is_refused_in_plain_words(tmp_path: Path) -> None:
    contents = [("a.glb", glb([])), ("b.glb", glb(None)), ("c.glb", glb(5)), ("a.gltf", b"[]"), ("b.gltf", b"null")]
    contents += [("c.gltf", b'{"extras": ' + b"[" * 200_000), ("d.gltf", b'{"scene": ' + b"9" * 5000 + b"}")]
    for name, content in contents:
        with pytest.raises(ValueError, match="JSON") as caught:
            load_mesh(write(tmp_path, name, content))
        assert not INTERNALS.search(str(caught.value))


def test_a_file_without_its_binary_part(tmp_path: Path) -> None:
    whole = triangle_glb()
    end = 20 + int.from_bytes(whole[12:16], "little")
    header = whole[20:end]
    for name, content in (
        ("a.gltf", header),
        ("a.glb", whole[:8] + end.to_bytes(4, "little") + whole[12:end]),
    ):
        with pytest.raises(ValueError, match=f"{TOO_SHORT}: it has 0 of 36 bytes"):
            load_mesh(write(tmp_path, name, content))


def test_null_and_empty_lists_count_as_absent(tmp_path: Path) -> None:
    node = {"mesh": 0, "skin": None, "matrix": None, "children": None}
    header = triangle_glb(nodes=[node], scenes=[], scene=None)
    assert b'"matrix": null' in header
    assert len(load_mesh(write(tmp_path, "a.glb", header)).faces) == 1
    for indices in ((0,), (0, 1, 2)):
        assert len(load_mesh(write(tmp_path, "b.glb", triangle_glb(**_sparse(*indices)))).faces) == 1
