"""Checks and repairs of the bytes of a mesh file before trimesh parses them.

trimesh accepts some damaged files, misreads some valid ones, and has no limits on time and memory.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from ..runtime.text import decoded
from .glb_file import plain_glb
from .polygons import MAX_FACES, triangulated

MAX_BYTES = 2**30  # more than a text file of MAX_FACES has
LIBRARIES = "\0"  # before the name of each of an OBJ's material libraries, in one line
MAX_MATERIALS = 10_000  # in an OBJ; each becomes a mesh of its own
MAX_PLY_ROWS = 4 * MAX_FACES  # vertices, faces and edges


def repair(data: bytes, kind: str) -> bytes:
    """Rewrites a file so that trimesh reads it correctly.

    Args:
        data: the file.
        kind: OBJ, STL or GLB.

    Raises:
        ValueError: it is damaged, uses an unsupported extension, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    by_kind: dict[str, Callable[[bytes], bytes]] = {"OBJ": _obj, "STL": _stl, "GLB": plain_glb}
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
    libraries = [line.partition(b" ")[2] for line in lines if line.startswith(b"mtllib ")]
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
    # trimesh reads the first library alone
    others = (line for line in lines if not line.startswith(b"mtllib"))
    return b"\n".join([b"mtllib " + LIBRARIES.encode().join([b"", *libraries]), *others])


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
    corners = [line for line in text.lower().splitlines() if line.lstrip().startswith(b"vertex")]
    return b"\n".join([b"solid", *corners, b"endsolid"])
