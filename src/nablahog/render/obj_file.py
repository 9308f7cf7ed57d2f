"""OBJ files and their MTL, as Wavefront defines them and as other programs write them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from .companion_files import CompanionFiles
from .soup import BRIGHTNESS, MAX_FACES, Floats, Integers, Soup, as_lines, as_numbers, check_corners, make_soup, to_gray

MAX_MATERIALS = 10_000  # in an OBJ
MAX_LIBRARIES = 100  # MTL files of an OBJ

_SLASH, _BLANK = b"/ "
_STARTS = (b"v ", b"vt", b"f ", b"fo", b"us", b"mt")  # the first two letters of the lines that are read
_EXPECTED_FACES = "expected faces such as 1 2 3, 1/1 2/2 3/3 or 1//1 2//2 3//3"
_SIGN, _SIGN_AFTER_NAMES = b"#", b" # "  # of a remark; names may be "Material #25"

Rows = Callable[[bytes, bytes], tuple[list[int], list[bytes]]]
"""Returns where in a file the lines with a keyword are, and what is between it and the sign of a remark on each."""


class _Material(NamedTuple):
    """The brightness of its diffuse colour, and the name of its texture; None if it has none."""

    diffuse: float | None = None
    texture: str | None = None


def read_obj(data: bytes, companions: CompanionFiles) -> Soup:
    """The triangles of an OBJ file.

    The brightness of a corner is that of its material's texture, or else of its vertex, or else of the material.

    Raises:
        ValueError: it has too many materials, numbers that are none, or a face refers to what is not there.
    """
    polygons = data.count(b"\nf ")
    if polygons > MAX_FACES:  # before they take memory
        raise ValueError(f"at most {MAX_FACES:,} faces are allowed, got {polygons:,}")
    rows = _index_lines(as_lines(data))
    vertex_lines, vertex_texts = rows(b"v", _SIGN)
    place_lines, place_texts = rows(b"vt", _SIGN)
    face_lines, faces = rows(b"f", _SIGN)
    vertices, places = _parse_table(vertex_texts, least=3), _parse_table(place_texts, least=1)
    places = np.pad(places, ((0, 0), (0, 1)))[:, :2]  # of one number each, v is 0
    counts = np.array([len(face.split()) for face in faces], dtype=np.int64)
    numbers = _parse_corners(faces, int(counts.sum()))
    if (numbers < 0).any():
        before = np.stack([np.searchsorted(lines, face_lines) for lines in (vertex_lines, place_lines)], axis=1)
        numbers = _count_from_first(numbers, before.repeat(counts, axis=0))
    corners, at = numbers.T - 1
    check_corners(corners, len(vertices))
    materials, which = _read_materials(rows, companions, face_lines)
    which = which.repeat(counts)
    if vertices.shape[1] >= 6:
        brightness = to_gray(vertices[:, 3:6])[corners]
    else:
        brightness = np.array([BRIGHTNESS if m.diffuse is None else m.diffuse for m in materials])[which]
    textured = np.flatnonzero((at >= 0) & (at < len(places)))
    for texture, here in _group_by_texture(materials, which[textured]):
        sampled = companions.sample(texture, places[at[textured[here]]])
        if sampled is not None:
            brightness[textured[here]] = sampled
    return make_soup(vertices[:, :3], corners, counts, corner_brightness=brightness)


def _index_lines(lines: list[bytes]) -> Rows:
    places: dict[bytes, list[int]] = {start: [] for start in _STARTS}
    for number, line in enumerate(lines):
        start = line[:2]
        if start in places:
            places[start].append(number)
    older = [number for number in places[b"fo"] if lines[number].startswith(b"fo ")]  # an older word for f
    for number in older:
        lines[number] = b"f" + lines[number][2:]
    places[b"f "] = sorted(places[b"f "] + older)

    def rows(keyword: bytes, sign: bytes) -> tuple[list[int], list[bytes]]:
        start = keyword + b" "
        found = [number for number in places[start[:2]] if lines[number].startswith(start)]
        return found, [lines[number][len(start) :].partition(sign)[0] for number in found]

    return rows


def _parse_table(texts: Sequence[bytes], least: int) -> Floats:
    """The numbers of rows, as many columns as the shortest has, and at least so many."""
    widths = [len(text.split()) for text in texts]
    width = min(widths, default=least)
    if width < least:
        raise ValueError(f"expected rows of at least {least} numbers, got one of {width}")
    if max(widths, default=width) > width:
        texts = [b" ".join(text.split()[:width]) for text in texts]
    numbers = as_numbers(b" ".join(texts), np.float64, len(texts) * width, "expected numbers with decimal points")
    return numbers.reshape(len(texts), width)


def _parse_corners(faces: Sequence[bytes], count: int) -> Integers:
    """The numbers (corners, 2) of vertex and place in the texture, of which 0 is none, of all faces in a row.

    A corner is written as v, v/vt, v/vt/vn or v//vn.
    """
    text = b"  ".join([b"", *faces])
    letters = np.frombuffer(text, np.uint8)
    divides = (letters == _SLASH) | (letters == _BLANK)
    starts = np.flatnonzero(divides[:-1] & ~divides[1:]) + 1
    numbers = as_numbers(text.replace(b"/", b" "), np.int64, len(starts), _EXPECTED_FACES)
    is_first = letters[starts - 1] == _BLANK  # of its corner
    if is_first.sum() != count:
        raise ValueError(_EXPECTED_FACES)
    slashes = np.where(is_first, 0, 1 + (letters[starts - 2] == _SLASH)).cumsum()
    kind = slashes - np.maximum.accumulate(np.where(is_first, slashes, 0))  # 0: vertex, 1: place, 2: normal
    corner = is_first.cumsum() - 1
    table = np.zeros((count, 2), np.int64)
    table[corner[kind < 2], kind[kind < 2]] = numbers[kind < 2]
    return table


def _count_from_first(numbers: Integers, before: Integers) -> Integers:
    """Numbers (corners, 2) of which those below 0 counted backwards from their face, ``before`` which so many are."""
    counted = np.where(numbers < 0, numbers + before + 1, numbers)
    if (counted < 1)[numbers < 0].any():
        row, column = np.argwhere((counted < 1) & (numbers < 0))[0]
        raise ValueError(f"a face refers to {numbers[row, column]}, which is before the first {('v', 'vt')[column]}")
    return counted


def _read_materials(rows: Rows, companions: CompanionFiles, faces: Sequence[int]) -> tuple[list[_Material], Integers]:
    """The materials, and for each of the faces, given by their lines, which of these it has."""
    uses, names = rows(b"usemtl", _SIGN_AFTER_NAMES)
    libraries = dict.fromkeys(map(bytes.strip, rows(b"mtllib", _SIGN_AFTER_NAMES)[1]))
    numbers: dict[bytes, int] = {b"": 0}
    used = [0, *(numbers.setdefault(name.strip(), len(numbers)) for name in names)]
    for what, count, most in (
        ("materials", len(numbers), MAX_MATERIALS),
        ("MTL files", len(libraries), MAX_LIBRARIES),
    ):
        if count > most:
            raise ValueError(f"at most {most:,} {what} are allowed, got {count:,}")
    known = _read_mtl(b"\n".join(companions.read_libraries(name.decode()) for name in libraries))
    return [known.get(name, _Material()) for name in numbers], np.array(used)[np.searchsorted(uses, faces)]


def _group_by_texture(materials: Sequence[_Material], which: Integers) -> Iterator[tuple[str, Integers]]:
    """Each texture, and the corners that it is on, of which ``which`` says the materials."""
    textures: dict[str | None, int] = {}
    numbers = [textures.setdefault(material.texture, len(textures)) for material in materials]
    texture = np.array(numbers)[which]
    order = texture.argsort(kind="stable")
    ends = np.searchsorted(texture[order], np.arange(len(textures)), side="right")
    for name, here in zip(textures, np.split(order, ends), strict=False):
        if name is not None and len(here):
            yield name, here


def _read_mtl(text: bytes) -> dict[bytes, _Material]:
    """The materials by name; colours may be one level, and have decimal commas."""
    materials: dict[bytes, _Material] = {}
    name = b""
    for line in as_lines(text):
        keyword, _, rest = line.partition(b" ")
        material = materials.get(name, _Material())
        if keyword.lower() == b"newmtl":
            name = rest.partition(_SIGN_AFTER_NAMES)[0].strip()
            materials[name] = _Material()
        elif keyword.lower() == b"kd":
            words = rest.partition(b"#")[0].replace(b",", b".").split()
            with suppress(ValueError):  # of a spectral file
                colour = np.array(words * 3 if len(words) == 1 else words).astype(np.float64)
                materials[name] = material._replace(diffuse=float(to_gray(colour[None, :3])[0]))
        elif keyword.lower() == b"map_kd":
            materials[name] = material._replace(texture=rest.partition(_SIGN_AFTER_NAMES)[0].strip().decode())
    return materials
