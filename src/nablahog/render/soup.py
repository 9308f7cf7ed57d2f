"""What all readers of mesh files share: limits, texts and their numbers, colours, and triangles of polygons.

Polygons become fans where they are convex, and ears (Meisters 1975) where they are not.
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import decode_text

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Number = TypeVar("Number", np.float64, np.int64)

MAX_MESH_BYTES = 2**30  # more than a text file of MAX_FACES has
MAX_FACES = 5_000_000
_WINDOWS_NAN = re.compile(rb"-?(?:\b1\.#(?:IND|QNAN|SNAN|INF)\w*|\bnan\((?:ind|snan)?\))", re.IGNORECASE)
_REMARK = re.compile(rb"(?m)(?:^ *#| # )[^\n]*")  # but no "Material #25"
BRIGHTNESS = 0.8
"""The brightness of a mesh without colours."""
GRAY = (0.299, 0.587, 0.114)  # of R, G and B
_HIGHEST_FRACTION = 1.1  # the largest float that is no level up to 255: filters leave more than 1
MOST_CORNERS = 1000  # of a polygon that is not convex; its triangles take their square in time


class Soup(NamedTuple):
    """Triangles, unchecked: vertices (V, 3) float64, faces (F, 3) int64, brightness (V,) float64 in 0…1."""

    vertices: Floats
    faces: Integers
    brightness: Floats


def to_gray(colours: NDArray[Any]) -> Floats:
    """Gray in 0…1 of colours (..., 3 or 4).

    White is 255, or 65535 or the type's largest if a number is above; of floats 1, or 255 if one is far above 1.
    """
    numbers = np.nan_to_num(colours.astype(np.float64))
    largest = numbers.max(initial=0)
    if colours.dtype.kind in "iu":
        whites = (255, 65535, np.iinfo(colours.dtype).max)
        white = min(whites[2], next(white for white in whites if largest <= white))
    else:
        white = 1 if largest <= _HIGHEST_FRACTION else 255
    gray: Floats = (numbers[..., :3] / white) @ np.array(GRAY)
    return gray.clip(0, 1)


def make_soup(
    vertices: Floats,
    corners: Integers,
    counts: Integers,
    *,
    vertex_brightness: Floats | None = None,
    corner_brightness: Floats | None = None,
) -> Soup:
    """Polygons, as :func:`triangulate` takes them, with the brightness of corners, or else of vertices, if known."""
    check_corners(corners, len(vertices))
    brightness = np.full(len(vertices), BRIGHTNESS) if vertex_brightness is None else vertex_brightness
    if corner_brightness is not None:
        brightness = brightness.copy()
        brightness[corners] = corner_brightness
        if (brightness[corners] != corner_brightness).any():  # neighbours differ: a vertex for each corner
            vertices, brightness, corners = vertices[corners], corner_brightness, np.arange(len(corners))
    return Soup(vertices, triangulate(vertices, corners, counts), brightness)


def check_corners(corners: Integers, count: int) -> None:
    """Raises ValueError unless all corners are among ``count`` vertices."""
    if corners.size and not (corners.min() >= 0 and corners.max() < count):
        raise ValueError("a face refers to a vertex that the file does not hold")


def triangulate(vertices: Floats, corners: Integers, counts: Integers) -> Integers:
    """The triangles (F, 3) of polygons, in their order, with their orientation.

    Args:
        vertices: (V, 3).
        corners: indices of vertices, those of all polygons one after the other.
        counts: (P,), the number of corners of each polygon; one of fewer than 3 has no triangles.

    Raises:
        ValueError: a corner is no vertex, or a polygon that is not convex has more than :data:`MOST_CORNERS` corners.
    """
    check_corners(corners, len(vertices))
    starts = counts.cumsum() - counts
    triangles, polygons = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for count in np.unique(counts[counts >= 3]).tolist():
        members = np.flatnonzero(counts == count)
        loops = corners[starts[members, None] + np.arange(count)]  # (M, count)
        second = np.arange(1, count - 1)
        fans = loops[:, np.stack([0 * second, second, second + 1], axis=1)]  # (M, count - 2, 3)
        if count > 3:
            for number in np.flatnonzero(~_are_convex(vertices[loops])).tolist():
                fans[number] = loops[number][_cut_ears(vertices[loops[number]])]
        triangles.append(fans.reshape(-1, 3))
        polygons.append(members.repeat(count - 2))
    order = np.concatenate(polygons).argsort(kind="stable")
    return np.concatenate(triangles)[order]


def _signed_areas(points: Floats) -> Floats:
    """Twice the signed areas of the triangles at the corners of polygons (..., n, 3), seen along their mean normals."""
    before, after = points - np.roll(points, 1, -2), np.roll(points, -1, -2) - points
    normals = np.cross(points, np.roll(points, -1, -2)).sum(-2, keepdims=True)  # Newell's
    turns: Floats = (np.cross(before, after) * normals).sum(-1)
    return turns


def _are_convex(points: Floats) -> NDArray[np.bool_]:
    """Which polygons (M, n, 3) have no corner that turns the other way."""
    turns = _signed_areas(points - points.mean(-2, keepdims=True))
    convex: NDArray[np.bool_] = (turns >= -1e-9 * np.abs(turns).max(-1, keepdims=True)).all(-1)
    return convex


def _cut_ears(points: Floats) -> Integers:
    """Triangles (n - 2, 3) of one polygon (n, 3): again and again a corner is cut off whose triangle holds no other."""
    if len(points) > MOST_CORNERS:
        raise ValueError(f"a face that is not convex has at most {MOST_CORNERS:,} corners, got {len(points):,}")
    centred = points - points.mean(0)
    normal = np.cross(centred, np.roll(centred, -1, 0)).sum(0)
    axis = int(np.abs(normal).argmax())  # projected along it, the polygon keeps its shape best
    flat = np.delete(centred, axis, 1) * [1, 1 if (normal[axis] > 0) == (axis != 1) else -1]
    remaining, triangles = list(range(len(points))), []
    while len(remaining) > 3:
        # of a polygon that cuts itself, any
        ear = next((k for k in range(len(remaining)) if _is_ear(flat[remaining], k)), 0)
        triangles.append([remaining[ear - 1], remaining[ear], remaining[(ear + 1) % len(remaining)]])
        del remaining[ear]
    return np.array([*triangles, remaining])


def _is_ear(flat: Floats, at: int) -> bool:
    """Whether the corner ``at`` of a polygon (n, 2) turns left, and its triangle holds none of the others."""
    n = len(flat)
    ear = flat[[at - 1, at, (at + 1) % n]]
    sides = np.roll(ear, -1, 0) - ear
    if sides[0, 0] * sides[1, 1] <= sides[0, 1] * sides[1, 0]:
        return False
    corners = np.delete(flat, [(at - 1) % n, at, (at + 1) % n], 0)[:, None] - ear  # (n - 3, 3, 2)
    inside = (sides[:, 0] * corners[..., 1] >= sides[:, 1] * corners[..., 0]).all(1)
    coincides = (corners == 0).all(2).any(1)  # another corner at the same place, where a slit ends
    return not (inside & ~coincides).any()


def find_distinct(rows: Floats | Integers) -> tuple[Integers, Integers]:
    """Indices of the first of each distinct row, in any order, and for each row which of these it equals.

    As ``np.unique(rows, axis=0)``, in half the time.
    """
    order = np.lexsort(rows.T)
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    which = np.empty(len(rows), dtype=np.int64)
    which[order] = np.cumsum(new, dtype=np.int64) - 1  # torch.compile, which traces NumPy, sums no truth values
    return order[new], which


def as_utf8(text: bytes) -> bytes:
    """``text`` in UTF-8, without a mark, and with "nan" for what old programs of Windows write in its place.

    What is no Unicode is taken for Latin-1: remarks may have any encoding.
    """
    try:
        plain = decode_text(text).encode()
    except UnicodeDecodeError:
        plain = text.decode("latin-1").encode()
    return _WINDOWS_NAN.sub(b"nan", plain) if b"1.#" in plain or b"(" in plain else plain


def as_lines(text: bytes) -> list[bytes]:
    """The lines of a text in UTF-8 that are not empty, without tabs and blanks at their ends.

    Those that a backslash continues are one.
    """
    plain = as_utf8(text).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    if b"\\" in plain:
        plain = re.sub(rb"\\ *\n", b" ", _REMARK.sub(b"", plain))  # a remark is not continued
    return [line.strip() for line in plain.split(b"\n") if line]


def as_numbers(text: bytes, kind: type[Number], count: int, expected: str) -> NDArray[Number]:
    """The ``count`` numbers of a text, with blanks between them; ValueError says what was ``expected``."""
    numbers: NDArray[Number] = np.empty(0, kind)
    with suppress(ValueError):  # older versions of NumPy return the numbers before what is none
        numbers = np.fromstring(text, kind, sep=" ")
    if numbers.size != count:
        raise ValueError(expected)
    return numbers
