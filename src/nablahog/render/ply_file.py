"""PLY files (Turk 1994), text or binary: vertices, polygons, their colours, and their places in a texture."""

from __future__ import annotations

import codecs
import re
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .polygons import Floats, Soup, gray_of, soup_of

MAX_HEADER = 2**20  # bytes
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}
_CORNERS = ("vertex_indices", "vertex_index")
_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))  # of a vertex in the texture
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": None}


class Property(NamedTuple):
    """A column: its name, the type of its numbers, and for lists that of their lengths."""

    name: str
    kind: str
    length: str | None


class Element(NamedTuple):
    """A table of a file: its name, the number of its rows, and its columns."""

    name: str
    rows: int
    properties: list[Property]


class Texture(NamedTuple):
    """The name of an image file, and the place of each vertex (V, 2) in it."""

    name: str
    uv: Floats


Columns = dict[str, NDArray[Any]]  # numbers of each column; of a list, of all rows one after the other


def header_of(data: bytes) -> tuple[str | None, list[Element], int]:
    """The order of bytes (None for text), the tables, and where the first begins.

    Raises:
        ValueError: it is no header, or longer than :data:`MAX_HEADER`.
    """
    head, _, body = data.partition(b"end_header")
    if len(head) > MAX_HEADER:
        raise ValueError(f"its header has more than {MAX_HEADER:,} bytes")
    rest = body.partition(b"\n")[0]
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    formats = [line[1] for line in lines if len(line) > 1 and line[0] == "format"]
    if lines[:1] != [["ply"]] or len(formats) != 1 or formats[0] not in _ORDERS or rest.strip() or rest == body:
        raise ValueError("it does not begin with ply, its format and a header to end_header")
    elements: list[Element] = []
    for key, *words in filter(None, lines):
        if key == "element":
            name, count = words
            elements.append(Element(name, int(count), []))
            if int(count) < 0:
                raise _too_few(elements[-1])
        elif key == "property":
            length, kind = (_TYPES[words[1]], words[2]) if words[0] == "list" else (None, words[0])
            elements[-1].properties.append(Property(words[-1], _TYPES[kind], length))
    return _ORDERS[formats[0]], elements, len(data) - len(body) + len(rest) + 1


def read_ply(data: bytes, most_rows: int) -> tuple[Soup, Texture | None]:
    """The triangles of a PLY file, with the colours of its vertices, or else of its faces; and its texture, if any.

    What follows the last table is not read.

    Raises:
        ValueError: it is no such file, or rows are missing, or there are more than ``most_rows``.
    """
    data = data.removeprefix(codecs.BOM_UTF8)
    order, elements, at = header_of(data)
    rows = sum(element.rows for element in elements)
    if rows > most_rows:
        raise ValueError(f"at most {most_rows:,} rows are allowed, got {rows:,}")
    tables: dict[str, Columns] = {}
    lines = iter([] if order is not None else filter(None, map(bytes.split, data[at:].splitlines())))
    for element in elements:
        if order is None:
            tables[element.name] = _of_text(element, list(islice(lines, element.rows)))
        else:
            tables[element.name], at = _of_bytes(element, data, at, order)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if any(name not in vertex for name in "xyz"):
        raise ValueError("its vertices do not have three coordinates each")
    name = next((name for name in _CORNERS if name in face), None)
    if name is None:
        strips = (
            "its faces are strips of triangles, which are not read" if "tristrips" in tables else "it holds no faces"
        )
        raise ValueError(strips)
    vertices = np.stack([vertex[axis].astype(np.float64) for axis in "xyz"], axis=1)
    corners, counts = face[name].astype(np.int64), face[_length(name)].astype(np.int64)
    image, uv = _texture_file(data), _places(vertex)
    if image is not None and np.array_equal(face.get(_length("texcoord"), ()), 2 * counts):  # of each corner
        if corners.size and not (corners.min() >= 0 and corners.max() < len(vertices)):
            raise ValueError("a face refers to a vertex that it does not hold")
        vertices, vertex = vertices[corners], {}
        corners, uv = np.arange(len(corners)), face["texcoord"].astype(np.float64).reshape(-1, 2)
    of_vertices = _brightness(vertex)
    texture = None if image is None or uv is None else Texture(image, uv)
    of_faces = None if of_vertices is not None or texture is not None else _brightness(face)
    return soup_of(vertices, corners, counts, of_vertices=of_vertices, of_faces=of_faces), texture


def _texture_file(data: bytes) -> str | None:
    """The image file that the header names, as MeshLab writes it."""
    names = re.findall(rb"^comment TextureFile (.*?)\s*$", data[: data.find(b"end_header")], re.MULTILINE)
    if len(names) > 1:
        raise ValueError(f"at most one texture is read, it names {len(names)}")
    return names[0].decode(errors="replace") if names else None


def _places(vertex: Columns) -> Floats | None:
    names = next((names for names in _PLACES if all(name in vertex for name in names)), None)
    return None if names is None else np.stack([vertex[name].astype(np.float64) for name in names], axis=1)


def _length(name: str) -> str:
    """The column of the lengths of the lists of another."""
    return f"{name} length"


def _brightness(columns: Columns) -> Floats | None:
    names = next((names for names in _COLOURS if all(name in columns for name in names)), None)
    return None if names is None else gray_of(np.stack([columns[name] for name in names], axis=1))


def _of_text(element: Element, rows: list[list[bytes]]) -> Columns:
    if len(rows) < element.rows:
        raise _too_few(element)
    columns: dict[str, list[bytes]] = {}
    for row in rows:
        at = 0
        for name, _, length in element.properties:
            count = 1
            if length is not None:
                columns.setdefault(_length(name), []).append(row[at])
                count, at = int(row[at]), at + 1
            if not 0 <= count <= len(row) - at:
                raise ValueError(f"a row of the element {element.name} has too few numbers")
            columns.setdefault(name, []).extend(row[at : at + count])
            at += count
    kinds = {each.name: each.kind for each in element.properties}
    return {name: np.array(column).astype(np.float64).astype(kinds.get(name, "i8")) for name, column in columns.items()}


def _of_bytes(element: Element, data: bytes, at: int, order: str) -> tuple[Columns, int]:
    """The columns of a table that begins at a byte, and the byte behind it."""
    lengths = _lengths_of_a_row(element, data, at, order) if element.rows else []
    fields: list[tuple[Any, ...]] = []
    for (name, kind, length), count in zip(element.properties, lengths, strict=bool(lengths)):
        fields += [] if length is None else [(_length(name), order + length)]
        fields += [(name, order + kind)] if length is None else [(name, order + kind, (count,))]
    row = np.dtype(fields)
    whole = len(data) - at >= element.rows * row.itemsize
    if whole:
        table = np.frombuffer(data, row, element.rows, at)
        if all(
            (table[_length(name)] == table[_length(name)][:1]).all() for name, _, length in element.properties if length
        ):
            columns = {name: table[name].reshape(-1) for name in table.dtype.names or ()}
            return columns, at + element.rows * row.itemsize
    if not any(each.length for each in element.properties):
        raise _too_few(element)
    return _of_mixed(element, data, at, order)


def _lengths_of_a_row(element: Element, data: bytes, at: int, order: str) -> list[int]:
    """How long the lists of a row are; 1 for what is no list."""
    lengths = []
    for _, kind, length in element.properties:
        count = 1
        if length is not None:
            first = np.dtype(order + length)
            count = int(_numbers(element, data, first, 1, at)[0])
            at += first.itemsize
        lengths.append(count)
        at += count * np.dtype(kind).itemsize
    return lengths


def _of_mixed(element: Element, data: bytes, at: int, order: str) -> tuple[Columns, int]:
    """Row by row, since lists of one column have different lengths."""
    columns: dict[str, list[NDArray[Any]]] = {}
    for _ in range(element.rows):
        for (name, kind, length), count in zip(
            element.properties, _lengths_of_a_row(element, data, at, order), strict=True
        ):
            if length is not None:
                columns.setdefault(_length(name), []).append(np.array([count]))
                at += np.dtype(length).itemsize
            numbers = _numbers(element, data, np.dtype(order + kind), count, at)
            columns.setdefault(name, []).append(numbers)
            at += numbers.nbytes
    return {name: np.concatenate(parts) for name, parts in columns.items()}, at


def _numbers(element: Element, data: bytes, kind: np.dtype[Any], count: int, at: int) -> NDArray[Any]:
    if count < 0 or at + count * kind.itemsize > len(data):
        raise _too_few(element)
    return np.frombuffer(data, kind, count, at)


def _too_few(element: Element) -> ValueError:
    return ValueError(f"it promises {element.rows:,} rows of the element {element.name}, but has fewer")
