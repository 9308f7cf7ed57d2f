"""Checks and repairs of the bytes of a mesh file before trimesh parses them.

trimesh accepts some damaged files, misreads some valid ones, and has no limits on time and memory.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice, pairwise
from typing import Any

import numpy as np

MAX_BYTES = 2**30  # more than a text file of MAX_FACES has
MAX_FACES = 5_000_000
MAX_MATERIALS = 10_000  # in an OBJ; each becomes a mesh of its own
MAX_PLY_HEADER = 2**20  # bytes
MAX_PLY_ROWS = 4 * MAX_FACES  # vertices, faces and edges
MAX_NODES = 10_000  # in a GLB
MAX_GLB_HEADER = 2**24  # bytes; Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# these change what accessors mean; without a decoder, trimesh fills in zeros or raw integers
_ENCODED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization")
# what the geometry and its brightness are made of; names, for instance, are not, which trimesh repeats
_GLB_PARTS: dict[str, tuple[str, ...] | None] = {  # keys of the header, and of each of their entries (None: all keys)
    **dict.fromkeys(("asset", "scene", "accessors", "buffers", "bufferViews", "images", "textures")),
    "scenes": ("nodes",),
    "nodes": ("children", "mesh", "matrix", "translation", "rotation", "scale"),
    "meshes": ("primitives",),
}
_PRIMITIVE = ("attributes", "indices", "material", "mode")
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_STRIP = 5  # mode of triangle strips: each index but the first two makes a triangle
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}


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
    """``text`` in UTF-8; if it is not, it is taken for Latin-1: names and comments may have any encoding."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1").encode("utf-8")
    return text


def _obj(data: bytes) -> bytes:
    """Makes all vertex indices of faces absolute: trimesh misreads relative (negative) ones."""
    text = as_utf8(data)
    materials = len({part[: part.find(b"\n")] for part in text.split(b"usemtl ")})
    if materials > MAX_MATERIALS:
        raise ValueError(f"at most {MAX_MATERIALS:,} materials are allowed, got {materials:,}")
    if not any(map(_needs_absolute, io.BytesIO(text))):
        return text
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

    lines = text.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, line in enumerate(lines):
        key, *rest = line.split() or [b""]
        if key in counts:
            counts[key] += 1
        elif key == b"f":
            lines[number] = b" ".join([key, *map(corner, rest)])
    return b"\n".join(lines)


def _needs_absolute(line: bytes) -> bool:
    """Whether a line may be that of a face with an index below 1."""
    return line.lstrip().startswith(b"f") and any(sign in line for sign in (b"-", b" 0", b"\t0"))


def _stl(data: bytes) -> bytes:
    if len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return data
    text = as_utf8(data)
    if text[:5].lower() != b"solid" or b"endsolid" not in text.lower():
        raise ValueError("it is neither a whole text from solid to endsolid nor binary of the length that it promises")
    # one solid, as trimesh takes long for many
    corners = [line for line in io.BytesIO(text.lower()) if line.lstrip().startswith(b"vertex")]
    return b"".join([b"solid\n", *corners, b"\nendsolid"])


def _ply(data: bytes) -> bytes:
    """Triangulates polygons if they have different numbers of corners, which trimesh refuses."""
    head, end, body = data.partition(b"end_header")
    if len(head) > MAX_PLY_HEADER:
        raise ValueError(f"its header has more than {MAX_PLY_HEADER:,} bytes")
    head = as_utf8(head)
    header = head.decode("utf-8").splitlines()
    lines = [line.split() for line in header]
    start = body.find(b"\n") + 1
    if not start or body[:start].strip() or len(lines) < 2 or lines[0] != ["ply"] or lines[1][:1] != ["format"]:
        raise ValueError("it does not begin with ply, its format and a header to end_header")
    elements = list(_ply_elements(lines))
    rows = sum(count for _, count, _ in elements)
    if rows > MAX_PLY_ROWS:
        raise ValueError(f"at most {MAX_PLY_ROWS:,} rows are allowed, got {rows:,}")
    if lines[1][1] == "ascii":
        whole = (line for line in io.BytesIO(body[start:]) if not line.isspace())
        return b"".join([head, end, b"\n", *islice(whole, rows)])
    lists = sum("list" in line[:2] for line in lines)
    if not lists or b"texcoord" in head:
        return head + end + body
    order = "<" if "little" in lines[1][1] else ">"
    body = body[start:]
    start = 0
    for name, count, properties in elements:
        if name != "face":
            start += count * np.dtype([(field[-1], order + _PLY_TYPES[field[1]]) for field in properties]).itemsize
            continue
        if _uniform(body, start, count, properties, order):
            break
        polygons = _polygons(body, start, count, properties, order)
        fans = [[first, b, c] for first, *others in polygons for b, c in pairwise(others)]
        triangles = np.empty(len(fans), dtype=[("corners", "u1"), ("vertex_indices", order + "i4", (3,))])
        triangles["corners"], triangles["vertex_indices"] = 3, fans
        before = header[: next(number for number, line in enumerate(lines) if line[:2] == ["element", "face"])]
        element = [f"element face {len(fans)}", "property list uchar int vertex_indices", "end_header", ""]
        return "\n".join([*before, *element]).encode() + body[:start] + triangles.tobytes()
    return head + end + b"\n" + body


def _ply_elements(lines: Sequence[list[str]]) -> Iterator[tuple[str, int, list[list[str]]]]:
    """Each element's name, its number of rows, and its properties' lines up to the next element."""
    starts = [number for number, line in enumerate(lines) if line[:1] == ["element"]]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        count = int(lines[start][2])
        if count < 0:
            raise ValueError(f"it promises {count:,} rows of an element")
        yield lines[start][1], count, [line for line in lines[start:end] if line[:1] == ["property"]]


def _uniform(body: bytes, at: int, count: int, properties: Sequence[list[str]], order: str) -> bool:
    """Whether all faces have as many corners as the first."""
    corners = len(next(_polygons(body, at, min(count, 1), properties, order), ()))
    fields = []
    for _, *types, name in properties:
        if types[0] == "list":
            fields += [("corners", order + _PLY_TYPES[types[1]]), (name, order + _PLY_TYPES[types[2]], (corners,))]
        else:
            fields += [(name, order + _PLY_TYPES[types[0]])]
    if at + count * np.dtype(fields).itemsize > len(body):
        return False
    return bool((np.frombuffer(body, np.dtype(fields), count, at)["corners"] == corners).all())


def _polygons(body: bytes, at: int, count: int, properties: Sequence[list[str]], order: str) -> Iterator[list[int]]:
    """The faces' vertices: the elements of the only list among the properties."""
    for _ in range(count):
        polygon: list[int] = []
        for _, *types, _ in properties:
            first = np.dtype(order + _PLY_TYPES[types[1] if types[0] == "list" else types[0]])
            if types[0] == "list":
                items = np.dtype(order + _PLY_TYPES[types[2]])
                corners = int(np.frombuffer(body, first, 1, at)[0])
                polygon = np.frombuffer(body, items, corners, at + first.itemsize).tolist()
                at += corners * items.itemsize
            at += first.itemsize
        yield polygon


def _glb(data: bytes) -> bytes:
    """Refuses what would unpack to much more than the file; leaves out what is no part of the geometry's brightness."""
    if data[:4] != b"glTF" or len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
        raise ValueError("it does not begin with glTF, or is truncated")
    end = 20 + int.from_bytes(data[12:16], "little")
    if end - 20 > MAX_GLB_HEADER:
        raise ValueError(f"its JSON has more than {MAX_GLB_HEADER:,} bytes")
    header = json.loads(data[20:end])
    for name in header.get("extensionsRequired", ()):
        if name in _ENCODED:
            raise ValueError(f"it needs the extension {name}, which is not supported")
    for uri in (buffer.get("uri", "data:") for buffer in header.get("buffers", ())):
        if not uri.startswith("data:"):
            raise ValueError(f"it needs the file {uri[:200]!r}, and only GLB files that need no other are read")
    _check_sizes(header, len(data))
    _check_tree(header.get("nodes", ()))
    given = {name: keys for name, keys in _GLB_PARTS.items() if name in header}
    plain = {name: _only(header[name], keys) if keys else header[name] for name, keys in given.items()}
    for mesh in plain.get("meshes", ()):
        mesh["primitives"] = _only(mesh["primitives"], _PRIMITIVE)
    if "materials" in header:
        plain["materials"] = [_plain_material(material) for material in header["materials"]]
    text, rest = json.dumps(plain).encode(), data[end:]
    lengths = [number.to_bytes(4, "little") for number in (20 + len(text) + len(rest), len(text))]
    return b"".join([data[:8], *lengths, data[16:20], text, rest])


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
        _count(accessor, "count") * _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
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
        faces += corners if primitive.get("mode") == _STRIP else corners // 3
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
