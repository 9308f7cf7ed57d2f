"""Checks and repairs of the bytes of a mesh file before trimesh parses them.

trimesh accepts some damaged files, misreads some valid ones, and has no limits on time and memory.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

MAX_BYTES = 2**30  # a text file of MAX_FACES has fewer
MAX_FACES = 5_000_000
MAX_NODES = 10_000  # of a GLB
MAX_DEPTH = 100  # of a GLB's tree of nodes: each node's place is multiplied together from all above it

# these change what accessors mean; without a decoder, trimesh fills in zeros or raw integers
_ENCODED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization")
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}


def repair(data: bytes, kind: str) -> bytes:
    """Rewrites a file so that trimesh reads it correctly.

    Args:
        data: the file.
        kind: OFF, OBJ, PLY, STL or GLB.

    Raises:
        ValueError: it is damaged, uses an unsupported extension, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    by_kind: dict[str, Callable[[bytes], bytes]] = {"OFF": _off, "OBJ": _obj, "PLY": _ply, "STL": _stl, "GLB": _glb}
    return by_kind[kind](data)


def as_utf8(text: bytes) -> bytes:
    """``text`` in UTF-8; if it is not, it is taken for Latin-1: names and comments may have any encoding."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1").encode("utf-8")
    return text


def is_coff(data: bytes) -> bool:
    """Whether an OFF file has a colour on each vertex's line."""
    return re.match(rb"(\s|#.*\n)*COFF", data) is not None


def off_lines(data: bytes) -> tuple[int, list[str]]:
    """The number of vertices of an OFF file, and the lines of its vertices, followed by those of its faces.

    Raises:
        ValueError: it is no such file, or lines are missing.
    """
    lines = [line.partition("#")[0].strip() for line in data.decode("utf-8").splitlines()]
    lines = [line for line in lines if line]
    match = re.fullmatch(r"C?OFF\b\s*(.*)", lines[0]) if lines else None
    counts, *body = [match[1], *lines[1:]] if match and match[1] else lines[1:] or [""]
    if match is None or len(counts.split()) < 2:
        raise ValueError("it does not begin with OFF or COFF and the numbers of vertices and faces")
    vertices, faces = (int(count) for count in counts.split()[:2])
    if len(body) < vertices + faces:
        promised = f"{vertices:,} vertices and {faces:,} faces"
        raise ValueError(f"it promises {promised}, each on a line of its own, but has {len(body):,} lines of them")
    last = body[vertices + faces - 1].split() if faces else ["0"]
    if len(last) <= int(last[0]):
        raise ValueError(f"its last face should have {last[0]} corners, and has {len(last) - 1}")
    return vertices, body[: vertices + faces]


def _off(data: bytes) -> bytes:
    """Triangulates polygons if some have more than four corners, which trimesh refuses."""
    text = as_utf8(data)
    vertices, lines = off_lines(text)
    if not any(int(line.split(maxsplit=1)[0]) > 4 for line in lines[vertices:]):
        return text
    corners = [(int(count), others) for count, *others in map(str.split, lines[vertices:])]
    polygons = [others[:count] for count, others in corners if count >= 3]
    fans = [f"3 {first} {b} {c}" for first, *others in polygons for b, c in pairwise(others)]
    keyword = "COFF" if is_coff(text) else "OFF"
    return "\n".join([keyword, f"{vertices} {len(fans)} 0", *lines[:vertices], *fans, ""]).encode()


def _obj(data: bytes) -> bytes:
    """Makes all vertex indices of faces absolute: trimesh misreads relative (negative) ones."""
    text = as_utf8(data)
    if re.search(rb"^\s*f\s(.*\s)?(0\b|[-\d/]*-)", text, flags=re.MULTILINE) is None:
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


def _stl(data: bytes) -> bytes:
    if len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return data
    text = as_utf8(data)
    if text[:5].lower() != b"solid" or b"endsolid" not in text.lower():
        raise ValueError("it is neither a whole text from solid to endsolid nor binary of the length that it promises")
    return text


def _ply(data: bytes) -> bytes:
    """Triangulates polygons if they have different numbers of corners, which trimesh refuses."""
    head, end, body = data.partition(b"end_header")
    head = as_utf8(head)
    newline = re.match(rb"\s*?\n", body)
    lines = [line.split() for line in head.decode("utf-8").splitlines()]
    if newline is None or len(lines) < 2 or lines[0] != ["ply"] or lines[1][:1] != ["format"]:
        raise ValueError("it does not begin with ply, its format and a header to end_header")
    lists = sum("list" in line[:2] for line in lines)
    if lines[1][1] == "ascii" or not lists or b"texcoord" in head:
        return head + end + body
    order = "<" if "little" in lines[1][1] else ">"
    start = newline.end()
    for name, count, properties in _ply_elements(lines):
        if name != "face":
            start += count * np.dtype([(field[-1], order + _PLY_TYPES[field[1]]) for field in properties]).itemsize
            continue
        if _uniform(body, start, count, properties, order):
            break
        polygons = _polygons(body, start, count, properties, order)
        fans = [[first, b, c] for first, *others in polygons for b, c in pairwise(others)]
        rows = np.empty(len(fans), dtype=[("corners", "u1"), ("vertex_indices", order + "i4", (3,))])
        rows["corners"], rows["vertex_indices"] = 3, fans
        before = head[: re.search(rb"^element\s+face", head, flags=re.MULTILINE).start()]  # type: ignore[union-attr]
        element = f"element face {len(fans)}\nproperty list uchar int vertex_indices\nend_header\n"
        return before + element.encode() + body[newline.end() : start] + rows.tobytes()
    return head + end + body


def _ply_elements(lines: Sequence[list[str]]) -> Iterator[tuple[str, int, list[list[str]]]]:
    """Each element's name, its number of rows, and its properties' lines up to the next element."""
    starts = [number for number, line in enumerate(lines) if line[:1] == ["element"]]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        yield lines[start][1], int(lines[start][2]), [line for line in lines[start:end] if line[:1] == ["property"]]


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
    if data[:4] != b"glTF" or len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
        raise ValueError("it does not begin with glTF, or is truncated")
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    for name in header.get("extensionsRequired", ()):
        if name in _ENCODED:
            raise ValueError(f"it needs the extension {name}, which is not supported")
    for buffer in header.get("buffers", ()):
        if not buffer.get("uri", "data:").startswith("data:"):
            raise ValueError(f"it needs the file {buffer['uri']!r}, and only GLB files that need no other are read")
    sizes = {
        "nodes": (len(header.get("nodes", ())), MAX_NODES),
        "numbers": (sum(accessor["count"] for accessor in header.get("accessors", ())), 10 * MAX_FACES),
        "bytes in views": (sum(view["byteLength"] for view in header.get("bufferViews", ())), MAX_BYTES),
    }
    for what, (size, limit) in sizes.items():
        if size > limit:
            raise ValueError(f"at most {limit:,} {what} are allowed, got {size:,}")
    _check_tree(header.get("nodes", ()))
    return data


def _check_tree(nodes: Sequence[dict[str, Any]]) -> None:
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", ())}
    if len(parents) < sum(len(node.get("children", ())) for node in nodes):
        raise ValueError("its nodes are no tree: one has two parents")
    for child in parents:
        depth = 0
        while child in parents:
            child, depth = parents[child], depth + 1
            if depth > MAX_DEPTH:
                raise ValueError(f"its nodes are nested in more than {MAX_DEPTH} levels, or in a circle")
