"""STL files, text or binary: triangles, and Magics' colours."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from .soup import BRIGHTNESS, GRAY, Floats, Soup, as_numbers, as_utf8

_HEADER = 80  # bytes
_EXPECTED_FACET = "a facet must have three corners of three numbers each, with decimal points"
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes, most_faces: int) -> Soup:
    """The triangles of an STL file; what follows the last one is not read.

    Colours are those of Magics: after COLOR= in the header that of all facets, and in the attribute of a facet its own.

    Raises:
        ValueError: it is no such file, is truncated, or has more than ``most_faces`` triangles.
    """
    count = int.from_bytes(data[_HEADER : _HEADER + 4], "little")
    is_binary = 0 < count <= (len(data) - _HEADER - 4) // _FACET.itemsize  # of a text, four letters promise far more
    text = b"" if is_binary else as_utf8(data).lower().lstrip()
    faces = count if is_binary else text.count(b"vertex") // 3
    if faces > most_faces:
        raise ValueError(f"at most {most_faces:,} faces are allowed, got {faces:,}")
    if is_binary:
        facets = np.frombuffer(data, _FACET, count, _HEADER + 4)
        corners = facets["corners"].astype(np.float64).reshape(-1, 3)
        brightness = _facet_brightness(data[:_HEADER], facets["attribute"]).repeat(3)
    else:
        corners = _read_text(text)
        brightness = np.full(len(corners), BRIGHTNESS)
    return Soup(corners, np.arange(len(corners)).reshape(-1, 3), brightness)


def _facet_brightness(header: bytes, attributes: NDArray[np.uint16]) -> Floats:
    """The brightness of the facets."""
    _, key, colour = header.partition(b"COLOR=")
    if not key or len(colour) < 3:
        return np.full(len(attributes), BRIGHTNESS)
    own = (attributes[:, None] >> np.array([0, 5, 10]) & 31) / 31  # red in the lowest bits
    colours = np.where(attributes[:, None] & 2**15, np.frombuffer(colour, np.uint8, 3) / 255, own)
    gray: Floats = colours @ np.array(GRAY)
    return gray


def _read_text(text: bytes) -> Floats:
    """The corners (3 F, 3), of all solids."""
    if not text.startswith(b"solid") or b"endsolid" not in text:
        raise ValueError("it is neither a whole text from solid to endsolid nor binary of the length that it promises")
    found = re.findall(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", text)
    loops = text.count(b"endloop")
    if len(found) % 3 or (loops and len(found) != 3 * loops):
        raise ValueError(_EXPECTED_FACET)
    return as_numbers(b" ".join(found), np.float64, 3 * len(found), _EXPECTED_FACET).reshape(-1, 3)
