"""Checks and repairs of the bytes of a mesh file before trimesh parses them.

trimesh accepts some damaged files, misreads some valid ones, and has no limits on time and memory.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import decoded
from .ply_file import header_of
from .polygons import triangulated

MAX_BYTES = 2**30  # more than a text file of MAX_FACES has
MAX_FACES = 5_000_000
MAX_MATERIALS = 10_000  # in an OBJ; each becomes a mesh of its own
MAX_PLY_ROWS = 4 * MAX_FACES  # vertices, faces and edges
MAX_NODES = 10_000  # in a GLB
MAX_GLB_HEADER = 2**24  # bytes; Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# extensions that change no geometry and hardly any brightness; others may change what numbers mean, as compression does
_HARMLESS = ("KHR_materials_", "KHR_lights_punctual", "KHR_xmp_json_ld")
# what the geometry and its brightness are made of; names, for instance, are not, which trimesh repeats
_GLB_PARTS: dict[str, tuple[str, ...] | None] = {  # keys of the header, and of each of their entries (None: all keys)
    **dict.fromkeys(("asset", "scene", "accessors", "buffers", "bufferViews", "images", "textures")),
    "scenes": ("nodes",),
    "nodes": ("children", "mesh", "matrix", "translation", "rotation", "scale"),
    "meshes": ("primitives",),
}
_PRIMITIVE = ("attributes", "indices", "material", "mode")
_COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives; in the last two each index but two makes a triangle


def repair(data: bytes, kind: str) -> bytes:
    """Rewrites a file so that trimesh reads it correctly.

    Args:
        data: the file.
        kind: OBJ, PLY, STL or GLB.

    Raises:
        ValueError: it is damaged, uses an unsupported extension, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    by_kind: dict[str, Callable[[bytes], bytes]] = {"OBJ": _obj, "PLY": _ply, "STL": _stl, "GLB": _glb}
    return by_kind[kind](data)


def as_utf8(text: bytes) -> bytes:
    """``text`` in UTF-8, without a mark; what is no Unicode is taken for Latin-1: remarks may have any encoding."""
    try:
        return decoded(text).encode()
    except UnicodeDecodeError:
        return text.decode("latin-1").encode()


def _obj(data: bytes) -> bytes:
    """Rewrites the faces, of which trimesh misreads those with relative (negative) indices, and cuts all as fans."""
    text = re.sub(rb"[ \t]*(?:\r\n?|\n)[ \t]*", b"\n", as_utf8(data).replace(b"\\\r\n", b" ").replace(b"\\\n", b" "))
    text = text.replace(b"\t", b" ").strip() + b"\n"
    materials = len({part[: part.find(b"\n")] for part in text.split(b"usemtl ")})
    if materials > MAX_MATERIALS:
        raise ValueError(f"at most {MAX_MATERIALS:,} materials are allowed, got {materials:,}")
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    kinds = tuple(counts)

    def corner(text: bytes) -> bytes:
        return b"/".join(index(kind, part) for kind, part in zip(kinds, text.split(b"/"), strict=False))

    def index(kind: bytes, text: bytes) -> bytes:
        if not text:
            return text
        number = int(text)
        number += counts[kind] + 1 if number < 0 else 0
        if number < 1:
            raise ValueError(f"a face refers to {text.decode()}, which is before the first {kind.decode()}")
        return str(number).encode()

    lines = text.split(b"\n")
    polygons: dict[int, list[bytes]] = {}  # by their lines
    for number, line in enumerate(lines):
        key, *rest = line.partition(b"#")[0].split() or [b""]
        if key in counts:
            counts[key] += 1
            lines[number] = b" ".join([key, *rest])
        elif key == b"f":
            if b"-" in line or b" 0" in line:
                rest = list(map(corner, rest))
            lines[number] = b" ".join([key, *rest])
            if len(rest) > 3:
                polygons[number] = rest
    for number, triangles in _cut(lines, polygons):
        lines[number] = b"\n".join(triangles)
    return b"\n".join(lines)


def _cut(lines: Sequence[bytes], polygons: Mapping[int, list[bytes]]) -> Iterator[tuple[int, list[bytes]]]:
    """The lines of the triangles that each polygon consists of, by the number of its line."""
    if not polygons:
        return
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith(b"v ")]).astype(np.float64)
    corners = list(chain.from_iterable(polygons.values()))
    at = np.array([int(each.partition(b"/")[0]) - 1 for each in corners])
    if at.max() >= len(vertices):
        raise ValueError("a face refers to a vertex that it does not hold")
    counts = np.array([len(each) for each in polygons.values()])
    triangles, which = triangulated(vertices[at], np.arange(len(at)), counts)
    starts = np.searchsorted(which, np.arange(len(counts) + 1))
    for number, start, stop in zip(polygons, starts, starts[1:], strict=False):
        yield number, [b"f " + b" ".join(corners[k] for k in each) for each in triangles[start:stop].tolist()]


def _stl(data: bytes) -> bytes:
    length = 84 + 50 * int.from_bytes(data[80:84], "little")
    if 84 < length <= len(data):  # of a text, these four letters promise far more
        return data[:length]
    text = as_utf8(data)
    if text[:5].lower() != b"solid" or b"endsolid" not in text.lower():
        raise ValueError("it is neither a whole text from solid to endsolid nor binary of the length that it promises")
    # one solid, as trimesh takes long for many
    corners = [line for line in io.BytesIO(text.lower()) if line.lstrip().startswith(b"vertex")]
    return b"".join([b"solid\n", *corners, b"\nendsolid"])


def _ply(data: bytes) -> bytes:
    _, elements, _ = header_of(data)
    rows = sum(element.rows for element in elements)
    if rows > MAX_PLY_ROWS:
        raise ValueError(f"at most {MAX_PLY_ROWS:,} rows are allowed, got {rows:,}")
    return data


def _glb(data: bytes) -> bytes:
    """Refuses what would unpack to much more than the file; leaves out what is no part of the geometry's brightness."""
    if data[:4] != b"glTF" or len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
        raise ValueError("it does not begin with glTF, or is truncated")
    end = 20 + int.from_bytes(data[12:16], "little")
    if end - 20 > MAX_GLB_HEADER:
        raise ValueError(f"its JSON has more than {MAX_GLB_HEADER:,} bytes")
    header = json.loads(data[20:end])
    for name in header.get("extensionsRequired", ()):
        if not str(name).startswith(_HARMLESS):
            raise ValueError(f"it needs the extension {name}, which is not supported")
    for uri in (buffer.get("uri", "data:") for buffer in header.get("buffers", ())):
        if not uri.startswith("data:"):
            raise ValueError(f"it needs the file {uri[:200]!r}, and only GLB files that need no other are read")
    _check_sizes(header, len(data))
    _check_tree(header.get("nodes", ()))
    known = {name: keys for name, keys in _GLB_PARTS.items() if name in header}
    plain = {name: _only(header[name], keys) if keys else header[name] for name, keys in known.items()}
    for mesh in plain.get("meshes", ()):
        mesh["primitives"] = _only(mesh["primitives"], _PRIMITIVE)
    if "materials" in header:
        plain["materials"] = [_plain_material(material) for material in header["materials"]]
    rest = _plain_chunk(plain, data[end:])
    text = json.dumps(plain).encode()
    lengths = [number.to_bytes(4, "little") for number in (20 + len(text) + len(rest), len(text))]
    return b"".join([data[:8], *lengths, data[16:20], text, rest])


def _plain_chunk(header: dict[str, Any], chunk: bytes) -> bytes:
    """The binary chunk with what trimesh does not read written out: sparse accessors, fans.  Changes the header."""
    accessors, views = header.get("accessors", []), header.get("bufferViews", [])
    added: list[bytes] = []
    end = len(chunk) - 8 + -len(chunk) % 4

    def view_of(numbers: NDArray[Any]) -> int:
        nonlocal end
        added.append(numbers.tobytes() + b"\0" * (-numbers.nbytes % 4))
        views.append({"buffer": 0, "byteOffset": end, "byteLength": numbers.nbytes})
        end += len(added[-1])
        return len(views) - 1

    for accessor in [each for each in accessors if "sparse" in each]:
        sparse = accessor.pop("sparse")
        dense = _numbers(header, chunk, accessor, accessor)
        at = _numbers(header, chunk, {"count": sparse["count"], "type": "SCALAR"}, sparse["indices"])
        dense[at[:, 0]] = _numbers(header, chunk, {**accessor, "count": sparse["count"]}, sparse["values"])
        accessor |= {"bufferView": view_of(dense), "byteOffset": 0}
    for fan in [each for mesh in header.get("meshes", ()) for each in mesh["primitives"] if each.get("mode") == _FAN]:
        corners = np.arange(accessors[fan["attributes"]["POSITION"]]["count"])
        if "indices" in fan:
            accessor = accessors[fan["indices"]]
            corners = _numbers(header, chunk, accessor, accessor)[:, 0]
        parts = np.broadcast_arrays(corners[:1], corners[1:-1], corners[2:])
        triangles = np.stack(parts, axis=1).astype("<u4")
        fan |= {"mode": _TRIANGLES, "indices": len(accessors)}
        new = {"bufferView": view_of(triangles), "componentType": 5125, "type": "SCALAR", "count": triangles.size}
        accessors.append(new)
    if not added:
        return chunk
    header["buffers"][0]["byteLength"] = end
    return b"".join([end.to_bytes(4, "little"), chunk[4:], b"\0" * (-len(chunk) % 4), *added])


def _numbers(header: dict[str, Any], chunk: bytes, shape: dict[str, Any], place: dict[str, Any]) -> NDArray[Any]:
    """A copy of numbers (count, components) in the binary chunk; zeros where ``place`` names no view of it."""
    kind = np.dtype(_COMPONENT_TYPES[{**shape, **place}["componentType"]])
    count, width = _count(shape, "count"), _COMPONENTS[shape["type"]]
    if "bufferView" not in place:
        return np.zeros((count, width), kind)
    view = header["bufferViews"][place["bufferView"]]
    if view.get("buffer", 0) != 0 or "uri" in header["buffers"][0]:
        raise ValueError("its sparse accessors or triangle fans are not in its binary chunk")
    start = 8 + view.get("byteOffset", 0) + place.get("byteOffset", 0)
    strides = view.get("byteStride", width * kind.itemsize), kind.itemsize
    return np.array(np.ndarray((count, width), kind, chunk, start, strides))


def _only(entries: Any, keys: Collection[str]) -> Any:
    """The entries without what is not under one of the keys."""
    return [{key: value for key, value in entry.items() if key in keys} for entry in entries]


def _plain_material(material: dict[str, Any]) -> dict[str, Any]:
    """Its colour and texture alone."""
    plain = material.get("pbrMetallicRoughness", {})
    return {"pbrMetallicRoughness": {key: value for key, value in plain.items() if key.startswith("baseColor")}}


def _check_sizes(header: dict[str, Any], size: int) -> None:
    """Refuses a file of ``size`` bytes that would unpack to much more: views may overlap, and nodes share meshes."""
    nodes, accessors = header.get("nodes", ()), header.get("accessors", ())
    views = sum(_count(view, "byteLength") for view in header.get("bufferViews", ()))
    unpacked = sum(
        _count(accessor, "count") * int(_COMPONENT_TYPES[accessor["componentType"]][-1]) * _COMPONENTS[accessor["type"]]
        for accessor in accessors
    )
    meshes = [_size_of_mesh(mesh, accessors) for mesh in header.get("meshes", ())]
    placed = [meshes[node["mesh"]] for node in nodes if "mesh" in node]
    most_bytes, stored = size + SPARE_BYTES, sum(accessor["count"] for accessor in accessors)
    limits = [("nodes", len(nodes), MAX_NODES), ("bytes in views", views, most_bytes)]
    limits += [("bytes in accessors", unpacked, most_bytes)]
    for where, sizes in (("", meshes), (" in its nodes", placed)):
        most = {"primitives": MAX_NODES, "vertices": max(MAX_FACES, stored), "faces": MAX_FACES}
        limits += [(what + where, sum(each[k] for each in sizes), most[what]) for k, what in enumerate(most)]
    for what, number, limit in limits:
        if number > limit:
            raise ValueError(f"at most {limit:,} {what} are allowed, got {number:,}")


def _count(part: dict[str, Any], name: str) -> int:
    count = part[name]
    if type(count) is not int or count < 0:
        raise ValueError(f"{name} must be an integer of at least 0, got {str(count)[:60]}")
    return count


def _size_of_mesh(mesh: dict[str, Any], accessors: Sequence[dict[str, Any]]) -> tuple[int, int, int]:
    """The numbers of its primitives, vertices and faces."""
    vertices = faces = 0
    for primitive in mesh["primitives"]:
        count: int = accessors[primitive["attributes"]["POSITION"]]["count"]
        corners: int = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
        vertices += count
        faces += corners if primitive.get("mode") in (_STRIP, _FAN) else corners // 3
    return len(mesh["primitives"]), vertices, faces


def _check_tree(nodes: Sequence[dict[str, Any]]) -> None:
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", ())}
    if len(parents) < sum(len(node.get("children", ())) for node in nodes):
        raise ValueError("its nodes are no tree: one has two parents")
    levels = 0
    for child in parents:
        depth = 0
        while child in parents:
            child, depth = parents[child], depth + 1
            if depth > MAX_DEPTH:
                raise ValueError(f"its nodes are nested in more than {MAX_DEPTH} levels, or in a circle")
        levels += depth
        if levels > MAX_LEVELS:
            raise ValueError(f"at most {MAX_LEVELS:,} nodes above others are allowed, counted from each")
