"""PLY files (Turk 1994), text or binary: vertices, polygons, and the colours of either."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .soup import BRIGHTNESS, Floats, Integers, Soup, as_utf8, check_corners, make_soup, to_gray

MAX_HEADER_BYTES = 2**20
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8"},
}
_CORNERS = ("vertex_indices", "vertex_index")
_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_TEXTURED = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))  # coordinates of vertices in a texture
_END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(?:\r\n|\n|\r)")
_ORDERS_BY_FORMAT = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": None}


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


Columns = dict[str, NDArray[Any]]  # numbers of each column; of a list, of all rows one after the other


class Header(NamedTuple):
    """The order of bytes (None for text), the tables, where the first begins, and the names of image files.

    MeshLab writes these as remarks.
    """

    order: str | None
    elements: list[Element]
    start: int
    textures: list[str]


def read_header(data: bytes) -> Header:
    """The header of a file.

    Raises:
        ValueError: it is no header, or longer than :data:`MAX_HEADER_BYTES`.
    """
    end = _END.search(data, 0, MAX_HEADER_BYTES)
    text = as_utf8(data[: end.start()]).decode() if end else ""
    lines = [line.split() for line in re.split(r"[\r\n]+", text)]
    formats = [line[1] for line in lines if len(line) > 1 and line[0] == "format"]
    if end is None or lines[:1] != [["ply"]] or len(formats) != 1 or formats[0] not in _ORDERS_BY_FORMAT:
        limit = f"of at most {MAX_HEADER_BYTES:,} bytes"
        raise ValueError(f"it does not begin with ply, its format and a header {limit} to end_header")
    elements: list[Element] = []
    for key, *words in filter(None, lines):
        if key == "element":
            name, count = words
            elements.append(Element(name, int(count), []))
            if int(count) < 0:
                raise ValueError(f"it promises {count} rows of the element {name}")
        elif key == "property":
            kinds = words[1:-1] if words[0] == "list" else words[:1]
            if any(kind not in _TYPES for kind in kinds):
                raise ValueError(f"expected a type of PLY's, such as float or uchar, got the type {' '.join(kinds)}")
            length = _TYPES[kinds[0]] if words[0] == "list" else None
            elements[-1].properties.append(Property(words[-1].lower(), _TYPES[kinds[-1]], length))
    textures = re.findall(r"(?m)^\s*comment\s+TextureFile\s+(.*\S)", text.replace("\r", "\n"))
    return Header(_ORDERS_BY_FORMAT[formats[0]], elements, end.end(), textures)


def read_ply(data: bytes, most_rows: int, sample: Callable[[str, Floats], Floats | None]) -> Soup:
    """The triangles of a PLY file, with the colours of its textures, or else of its vertices, or else of its faces.

    What follows the last table is not read.

    Args:
        data: the file.
        most_rows: that it may have.
        sample: returns the brightness of an image file at places (N, 2), as MTL has them; None if it cannot be read.

    Raises:
        ValueError: it is no such file, or rows are missing, or there are more than ``most_rows``.
    """
    if data.startswith((codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = as_utf8(data)
    order, elements, at, textures = read_header(data)
    rows = sum(element.rows for element in elements)
    if rows > most_rows:
        raise ValueError(f"at most {most_rows:,} rows are allowed, got {rows:,}")
    tables: dict[str, Columns] = {}
    lines = iter([] if order is not None else filter(None, map(bytes.split, as_utf8(data[at:]).splitlines())))
    for element in elements:
        if element.name in tables:
            raise ValueError(f"it has the element {element.name} twice")
        if order is None:
            tables[element.name] = _read_text(element, list(islice(lines, element.rows)))
        else:
            tables[element.name], at = _read_binary(element, data, at, order)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if any(name not in vertex for name in "xyz"):
        raise ValueError("its vertices do not have three coordinates each")
    listed = next((name for name in _CORNERS if name in face), None)
    if listed is None or "tristrips" in tables:
        expected = "an element face with the list vertex_indices, and no strips"
        raise ValueError(f"it holds no faces that are read: expected {expected}, got the elements {', '.join(tables)}")
    if _length_column(listed) not in face:
        raise ValueError(f"expected a list {listed} in the element face, got one number")
    corners, counts = face[listed].astype(np.int64), face[_length_column(listed)].astype(np.int64)
    check_corners(corners, len(vertex["x"]))
    vertex_brightness, face_brightness = _row_brightness(vertex), _row_brightness(face)
    corner_brightness = (
        None if vertex_brightness is not None or face_brightness is None else face_brightness.repeat(counts)
    )
    places = _texture_places(vertex, face, corners, counts) if textures else None
    if places is not None:
        which = face["texnumber"].repeat(counts) if "texnumber" in face else np.zeros(len(corners))
        if corner_brightness is None:
            corner_brightness = (
                np.full(len(corners), BRIGHTNESS) if vertex_brightness is None else vertex_brightness[corners]
            )
        for number, name in enumerate(textures):
            sampled = sample(name, places[which == number])
            if sampled is not None:
                corner_brightness[which == number] = sampled
    vertices = np.stack([vertex[name].astype(np.float64) for name in "xyz"], axis=1)
    return make_soup(
        vertices, corners, counts, vertex_brightness=vertex_brightness, corner_brightness=corner_brightness
    )


def _texture_places(vertex: Columns, face: Columns, corners: Integers, counts: Integers) -> Floats | None:
    """Where in a texture each corner is, (corners, 2), by the list of its face or by its vertex; None if unknown."""
    if np.array_equal(face.get(_length_column("texcoord"), ()), 2 * counts):
        return face["texcoord"].astype(np.float64).reshape(-1, 2)
    names = next((names for names in _TEXTURED if all(name in vertex for name in names)), None)
    return None if names is None else np.stack([vertex[name].astype(np.float64) for name in names], axis=1)[corners]


def _length_column(name: str) -> str:
    """The column of the lengths of the lists of another."""
    return f"{name} length"


def _row_brightness(columns: Columns) -> Floats | None:
    names = next((names for names in _COLOURS if all(name in columns for name in names)), None)
    return None if names is None else to_gray(np.stack([columns[name] for name in names], axis=1))


def _read_text(element: Element, rows: list[list[bytes]]) -> Columns:
    if len(rows) < element.rows:
        raise _missing_rows_error(element)
    columns: dict[str, list[bytes]] = {}
    for row in rows:
        at = 0
        for name, _, length in element.properties:
            count = 1
            if length is not None and at < len(row):
                columns.setdefault(_length_column(name), []).append(row[at])
                count, at = int(row[at]), at + 1
            if not 0 <= count <= len(row) - at:
                raise ValueError(f"a row of the element {element.name} has too few numbers")
            columns.setdefault(name, []).extend(row[at : at + count])
            at += count
    kinds = {column.name: column.kind for column in element.properties}
    return {name: np.array(column).astype(np.float64).astype(kinds.get(name, "i8")) for name, column in columns.items()}


def _read_binary(element: Element, data: bytes, at: int, order: str) -> tuple[Columns, int]:
    """The columns of a table that begins at a byte, and the byte behind it."""
    lengths = _read_lengths(element, data, at, order) if element.rows else []
    fields: list[tuple[Any, ...]] = []
    for (name, kind, length), count in zip(element.properties, lengths, strict=bool(lengths)):
        fields += [] if length is None else [(_length_column(name), order + length)]
        fields += [(name, order + kind)] if length is None else [(name, order + kind, (count,))]
    row = np.dtype(fields)
    whole = len(data) - at >= element.rows * row.itemsize
    if whole:
        table = np.frombuffer(data, row, element.rows, at)
        if all(
            (table[_length_column(name)] == table[_length_column(name)][:1]).all()
            for name, _, length in element.properties
            if length
        ):
            columns = {name: table[name].reshape(-1) for name in table.dtype.names or ()}
            return columns, at + element.rows * row.itemsize
    if not any(column.length for column in element.properties):
        raise _missing_rows_error(element)
    return _read_row_by_row(element, data, at, order)


def _read_lengths(element: Element, data: bytes, at: int, order: str) -> list[int]:
    """How long the lists of a row are; 1 for what is not a list."""
    lengths = []
    for _, kind, length in element.properties:
        count = 1
        if length is not None:
            first = np.dtype(order + length)
            count = int(_read_numbers(element, data, first, 1, at)[0])
            at += first.itemsize
        if count < 0:
            raise ValueError(f"a row of the element {element.name} has a list of {count} numbers")
        lengths.append(count)
        at += count * np.dtype(kind).itemsize
    return lengths


def _read_row_by_row(element: Element, data: bytes, at: int, order: str) -> tuple[Columns, int]:
    """Row by row, since lists of one column have different lengths."""
    columns: dict[str, list[NDArray[Any]]] = {}
    for _ in range(element.rows):
        for (name, kind, length), count in zip(
            element.properties, _read_lengths(element, data, at, order), strict=True
        ):
            if length is not None:
                columns.setdefault(_length_column(name), []).append(np.array([count]))
                at += np.dtype(length).itemsize
            numbers = _read_numbers(element, data, np.dtype(order + kind), count, at)
            columns.setdefault(name, []).append(numbers)
            at += numbers.nbytes
    return {name: np.concatenate(parts) for name, parts in columns.items()}, at


def _read_numbers(element: Element, data: bytes, kind: np.dtype[Any], count: int, at: int) -> NDArray[Any]:
    if at + count * kind.itemsize > len(data):
        raise _missing_rows_error(element)
    return np.frombuffer(data, kind, count, at)


def _missing_rows_error(element: Element) -> ValueError:
    return ValueError(f"it has fewer rows of the element {element.name} than it promises: {element.rows:,}")
