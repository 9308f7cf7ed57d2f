"""Reading untrusted mesh files: OFF, PLY, STL, OBJ with MTL, GLB and glTF."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from ..io.input_file import InputFile
from ..runtime.text import one_line
from .companion_files import CompanionFiles
from .gltf_file import read_gltf
from .obj_file import read_obj
from .off_file import read_off
from .ply_file import read_ply
from .soup import MAX_FACES, MAX_MESH_BYTES, Soup, as_utf8, check_corners
from .stl_file import read_stl

MAX_PLY_ROWS = 4 * MAX_FACES  # vertices, faces and edges

_FORMATS = {".off": "OFF", ".obj": "OBJ", ".ply": "PLY", ".stl": "STL", ".glb": "GLB", ".gltf": "glTF"}
ENDINGS = tuple(_FORMATS)
# errors of parsers, and what is said instead
_NO_NUMBER = re.compile(
    r"(?:could not convert string to float|invalid literal for int\(\).*?): (?:np\.\w+\()?b?'([^']*)'"
)
_REASONS = {
    "is out of bounds for axis": "a face refers to a vertex that the file does not hold",
}


def read_soup(file: InputFile) -> Soup:
    """All triangles of a file, of one of :func:`~nablahog.render.mesh.load_mesh`'s formats.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, too big or damaged.
    """
    file.check("a mesh file")
    kind = _FORMATS.get(file.ending)
    if kind is None:
        expected = ", ".join(ENDINGS)
        raise ValueError(f"{file}: expected a mesh file ({expected}), got the ending {Path(file.name).suffix!r}")
    if file.size > MAX_MESH_BYTES:
        raise ValueError(f"{file}: a mesh file of more than {MAX_MESH_BYTES:,} bytes is refused")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy warns of odd numbers
        warnings.simplefilter("error", Image.DecompressionBombWarning)  # a texture too large counts as unreadable
        try:
            return _join(list(_read_pieces(file, kind)))
        except Exception as error:  # parsers of damaged files raise nearly anything
            reason = _reason(error)
            raise ValueError(f"{file}: expected a mesh in the format {kind}, but it cannot be read: {reason}") from None


def _reason(error: Exception) -> str:
    text = (str(error).splitlines() or [""])[0]
    if isinstance(error, KeyError):
        return one_line(f"it has no {text}", 300)
    if no_number := _NO_NUMBER.search(text):
        return f"expected a number, such as -1.5, got {one_line(no_number[1], 60)!r}"
    known = next((reason for part, reason in _REASONS.items() if part in text), None)
    return known or one_line(text, 300) or type(error).__name__


def _read_pieces(file: InputFile, kind: str) -> Iterator[Soup]:
    """The triangles of the file's geometries, which are at most :data:`MAX_FACES`."""
    count = 0
    for soup in _read(file, kind):
        count += len(soup.faces)
        if count > MAX_FACES:
            raise ValueError(f"at most {MAX_FACES:,} faces are allowed, got {count:,}")
        yield soup


def _read(file: InputFile, kind: str) -> Iterable[Soup]:
    data = file.read()
    if kind == "OFF":
        return [read_off(as_utf8(data).decode())]
    if kind == "STL":
        return [read_stl(data, MAX_FACES)]
    companions = CompanionFiles(Path(file.name).parent if file.content is None else None)
    if kind == "PLY":
        return [read_ply(data, MAX_PLY_ROWS, companions.sample)]
    if kind == "OBJ":
        return [read_obj(data, companions)]
    return read_gltf(data, companions)


def _join(pieces: list[Soup]) -> Soup:
    if not any(len(piece.faces) for piece in pieces):
        raise ValueError("it holds no faces")
    for piece in pieces:
        check_corners(piece.faces, len(piece.vertices))
        unused = np.ones(len(piece.vertices), dtype=bool)
        unused[piece.faces] = False
        piece.vertices[unused] = 0  # of depth cameras they are NaN
        if not np.isfinite(piece.vertices).all():
            raise ValueError("it holds coordinates that are not finite")
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return Soup(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)]),
        np.concatenate([piece.brightness for piece in pieces]),
    )
