"""OFF files, as Geomview defines them and as other programs write them."""

from __future__ import annotations

import re
from itertools import chain

import numpy as np

from .soup import BRIGHTNESS, Floats, Soup, make_soup, to_gray

# letters before the keyword: texture coordinates, colours, normals, and two that are not read
_KEYWORD = re.compile(r"((?:ST)?C?N?(?:ST)?)(4?n?)(?:OFF|off)\b", re.ASCII)
_GLUED = re.compile(r"((?:ST)?C?N?(?:ST)?4?n?OFF)(?=[\d-])", re.ASCII)  # ModelNet's OFF8 6 0


def read_off(text: str) -> Soup:
    """The triangles of an OFF file, with the colours of its vertices (COFF, or OFF if all have some) or of its faces.

    Numbers of colours are in 0…1, or integers in 0…255.  Remarks (#) and empty lines are skipped.  The
    keyword may be left out, and the counts may stand anywhere between it and the first vertex.

    Raises:
        ValueError: it does not begin with a keyword, is of another dimension or binary, or numbers are missing.
    """
    lines = [line for line in (line.partition("#")[0].strip() for line in text.splitlines()) if line]
    head = _GLUED.sub(r"\1 ", lines[0]) if lines else ""
    keyword = _KEYWORD.match(head)
    if keyword is None and head[:1].isdigit():  # the keyword may be left out
        keyword = _KEYWORD.match(head := f"OFF {head}")
    if keyword is None:
        raise ValueError("it does not begin with OFF, or COFF and the like")
    letters = keyword[1]
    if keyword[2] or "BINARY" in head:
        raise ValueError(f"it begins with {head[:40]!r}: expected text with three coordinates a vertex")
    (vertex_count, face_count), lines = _read_counts([head[keyword.end() :], *lines[1:]])
    if min(vertex_count, face_count) < 0 or len(lines) < vertex_count + face_count:
        promised = f"{vertex_count:,} + {face_count:,} lines of vertices and faces"
        raise ValueError(f"it promises {promised}, but has {len(lines):,}")
    first = 6 if "N" in letters else 3  # column of the first colour, behind position and normal
    rows = [line.split() for line in lines[:vertex_count]]
    if any(len(row) < 3 for row in rows):
        raise ValueError("its vertices do not have three coordinates each")
    vertices = np.array([row[:3] for row in rows], dtype=np.float64).reshape(-1, 3)
    last = first + (3 if "S" in letters else 4)
    colours_of_vertices = [row[first:last] for row in rows]
    has_colours = "C" in letters or (not letters and _are_colours(colours_of_vertices))
    if has_colours and any(len(colour) < 3 for colour in colours_of_vertices):
        raise ValueError("its vertices do not have a colour of three numbers each")
    vertex_brightness = _read_brightness(colours_of_vertices) if has_colours else None
    corners, colours = [], []
    for line in lines[vertex_count : vertex_count + face_count]:
        count, *numbers = line.split()
        if not 0 <= int(count) <= len(numbers):
            raise ValueError(f"expected a face of {count} vertex indices, got {len(numbers)}")
        corners.append(list(map(int, numbers[: int(count)])))
        colours.append(numbers[int(count) : int(count) + 4])
    corner_brightness = None
    coloured = [number for number, colour in enumerate(colours) if len(colour) >= 3]  # others: a table's index, or none
    if coloured and vertex_brightness is None:
        face_brightness = np.full(face_count, BRIGHTNESS)
        face_brightness[coloured] = _read_brightness([colours[number] for number in coloured])
        corner_brightness = face_brightness.repeat([len(polygon) for polygon in corners])
    all_corners = np.array(list(chain.from_iterable(corners)), dtype=np.int64)
    counts = np.array([len(polygon) for polygon in corners], dtype=np.int64)
    return make_soup(
        vertices, all_corners, counts, vertex_brightness=vertex_brightness, corner_brightness=corner_brightness
    )


def _read_counts(lines: list[str]) -> tuple[tuple[int, int], list[str]]:
    """The numbers of vertices and of faces, and the lines behind these and the number of edges."""
    numbers: list[int] = []
    for done, line in enumerate(lines):
        numbers += map(int, line.split())
        if len(numbers) >= 2:
            # the number of edges, which may be left out, is on the same line or alone on the next one
            alone = len(numbers) == 2 and done and [len(line.split()) for line in lines[done - 1 : done + 2]] == [1] * 3
            return (numbers[0], numbers[1]), lines[done + (2 if alone else 1) :]
    raise ValueError("the numbers of vertices and faces are missing")


def _are_colours(rows: list[list[str]]) -> bool:
    """Whether all vertices of a plain OFF have three or four more numbers, none negative: normals have signs."""
    return bool(rows) and all(len(row) >= 3 and not any(number.startswith("-") for number in row) for row in rows)


def _read_brightness(colours: list[list[str]]) -> Floats:
    # with the alpha, which tells 0…255 from 0…1 where the colours are dark
    return to_gray(np.array([[*colour, "0"][:4] for colour in colours], dtype=np.float64).reshape(-1, 4))
