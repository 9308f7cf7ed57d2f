"""What glTF does not allow in its JSON, and buffers that are not there, are refused by name and place."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nablahog.render.mesh import load_mesh

from .mesh_files import Glb, glb, triangle_glb, write

ACCESSOR = {"componentType": 5126, "type": "VEC3", "bufferView": 0, "count": 3}
VIEW = {"buffer": 0, "byteLength": 36}
TOO_SHORT = "the buffer is missing or shorter than byteLength says"
INTERNALS = re.compile("' object|has no attribute|out of range|recursion|digits")


def _sparse(index: int) -> dict[str, Any]:
    """A file whose sparse corner, at an index of one signed byte, is the first."""
    model = Glb([[0, 0, 0], [2, 0, 0], [0, 1, 0]])
    at = {"bufferView": model.view(np.array([index], "i1")), "componentType": 5120}
    model.header["accessors"][0]["sparse"] = {"count": 1, "indices": at, "values": {"bufferView": 0}}
    url = "data:;base64," + base64.b64encode(model.binary).decode()
    return {**model.header, "buffers": [{"byteLength": len(model.binary), "uri": url}]}


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
        (
            {"meshes": [{"primitives": [{"attributes": {"POSITION": -1}}]}]},
            "meshes[0].primitives[0].attributes.POSITION",
        ),
        (
            {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]},
            "meshes[0].primitives[0].indices",
        ),
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
    assert len(load_mesh(write(tmp_path, "b.glb", triangle_glb(**_sparse(0)))).faces) == 1
