"""Texts of mesh files as all readers take them; OBJ and MTL as trimesh reads them correctly.

trimesh accepts some damaged files, misreads some valid ones, and has no limits on time and memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from ..runtime.text import decoded
from .polygons import triangulated

MAX_BYTES = 2**30  # more than a text file of MAX_FACES has
MAX_FACES = 5_000_000
MAX_MATERIALS = 10_000  # in an OBJ; each becomes a mesh of its own
MAX_LIBRARIES = 100  # MTL files of an OBJ
LIBRARIES = "\t"  # between the names of the MTL files of an OBJ, as :func:`plain_obj` writes them

_NO_NUMBER = re.compile(rb"-?(?:\b1\.#(?:IND|QNAN|SNAN|INF)\w*|\bnan\((?:ind|snan)?\))", re.IGNORECASE)
_REMARK = re.compile(rb"(?m)(?:^#|[ \t]#[ \t])[^\n]*")  # but no "Material #25"
_ENDS = re.compile(rb"[ \t]*(?:\r\n?|\n)[ \t]*")


def as_utf8(text: bytes) -> bytes:
    """``text`` in UTF-8, without a mark, and with "nan" for what old programs of Windows write in its place.

    What is no Unicode is taken for Latin-1: remarks may have any encoding.
    """
    try:
        plain = decoded(text).encode()
    except UnicodeDecodeError:
        plain = text.decode("latin-1").encode()
    return _NO_NUMBER.sub(b"nan", plain) if b"#" in plain or b"(" in plain else plain


def _plain(text: bytes) -> bytes:
    """OBJ or MTL without remarks, tabs, and blanks at the ends of lines."""
    return _REMARK.sub(b"", _ENDS.sub(b"\n", as_utf8(text)).strip()).replace(b"\t", b" ")


def plain_mtl(data: bytes) -> bytes:
    """Rewrites colours of one level, or with decimal commas, which trimesh leaves out."""
    lines = [line.rstrip() for line in _plain(data).split(b"\n")]
    for number, line in enumerate(lines):
        if line[:3].lower() == b"kd ":
            words = line.partition(b"#")[0].replace(b",", b".").split()[1:]
            lines[number] = b" ".join([b"Kd", *(words * 3 if len(words) == 1 else words)])
    return b"\n".join(lines)


def plain_obj(data: bytes) -> bytes:
    """Rewrites an OBJ for trimesh: indices of faces count from the first, polygons are triangles.

    The names of all its MTL files are on its first line, divided by :data:`LIBRARIES`.

    Raises:
        ValueError: it has too many materials, or a face refers to what is not there.
    """
    text = _plain(data).replace(b"\\\n", b" ") + b"\n"
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

    lines = [line.strip() for line in text.split(b"\n")]
    libraries = list(dict.fromkeys(line[7:].strip() for line in lines if line.startswith(b"mtllib ")))
    if len(libraries) > MAX_LIBRARIES:
        raise ValueError(f"at most {MAX_LIBRARIES:,} MTL files are allowed, got {len(libraries):,}")
    polygons: dict[int, list[bytes]] = {}  # by their lines
    for number, line in enumerate(lines):
        key, *rest = line.partition(b"#")[0].split() or [b""]
        if key in counts:
            counts[key] += 1
            lines[number] = b" ".join([key, *rest])
        elif key == b"mtllib":
            lines[number] = b""
        elif key in (b"f", b"fo"):  # the second is an older word for the first
            if b"-" in line or b" 0" in line:
                rest = list(map(corner, rest))
            lines[number] = b" ".join([b"f", *rest])
            if len(rest) > 3:
                polygons[number] = rest
    for number, triangles in _cut(lines, polygons):
        lines[number] = b"\n".join(triangles)
    named = b"mtllib " + LIBRARIES.encode().join(libraries) if libraries else b""
    return b"\n".join([named, *lines])


def _cut(lines: Sequence[bytes], polygons: Mapping[int, list[bytes]]) -> Iterator[tuple[int, list[bytes]]]:
    """The lines of the triangles that each polygon consists of, by the number of its line."""
    if not polygons:
        return
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith(b"v ")]).astype(np.float64)
    corners = list(chain.from_iterable(polygons.values()))
    at = np.array([int(each.partition(b"/")[0]) - 1 for each in corners])
    if at.max() >= len(vertices):
        raise ValueError("a face refers to a vertex that the file does not hold")
    counts = np.array([len(each) for each in polygons.values()])
    triangles, which = triangulated(vertices[at], np.arange(len(at)), counts)
    starts = np.searchsorted(which, np.arange(len(counts) + 1))
    for number, start, stop in zip(polygons, starts, starts[1:], strict=False):
        yield number, [b"f " + b" ".join(corners[k] for k in each) for each in triangles[start:stop].tolist()]
