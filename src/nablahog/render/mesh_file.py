"""Reading untrusted mesh files with trimesh: OFF, OBJ with MTL, PLY, STL and GLB."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..io.files import check_file
from ..runtime.text import one_line
from .mesh_bytes import MAX_BYTES, MAX_FACES, as_utf8, repair

if TYPE_CHECKING:  # slow to import
    import trimesh

Floats = NDArray[np.float64]

BRIGHTNESS = 0.8
"""The brightness of a mesh without colours."""
MAX_BYTES_BESIDE = 2**29  # of all files that an OBJ or a PLY names; further ones are ignored
LONGEST_NAME = 1000  # characters of the name of such a file
MAX_TEXELS = 2**28  # of all textures of a file: more take too long to decode
TEXTURE = 64  # side that textures are shrunk to, in texels: vertices are farther apart than finer details

_FORMATS = {".off": "OFF", ".obj": "OBJ", ".ply": "PLY", ".stl": "STL", ".glb": "GLB"}
ENDINGS = tuple(_FORMATS)
_GRAY = (0.299, 0.587, 0.114)
_SHRUNK = (0, 0)  # the key of a texture's small version; no file can have it

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # trimesh's remarks would go to the terminal


class Soup(NamedTuple):
    """Triangles, unchecked: vertices (V, 3) float64, faces (F, 3) int64, brightness (V,) float64 in 0…1."""

    vertices: Floats
    faces: NDArray[np.int64]
    brightness: Floats


def read_soup(path: Path) -> Soup:
    """All triangles of the file ``path``, one of :func:`~nablahog.render.mesh.load_mesh`'s formats.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, too big or damaged.
    """
    check_file(path, "a mesh file")
    kind = _FORMATS.get(path.suffix.lower())
    if kind is None:
        expected = ", ".join(ENDINGS)
        raise ValueError(f"{path}: expected a mesh file ({expected}), got the ending {path.suffix or 'of no kind'!r}")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a mesh file of more than {MAX_BYTES:,} bytes is refused")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about odd numbers
        warnings.simplefilter("error", Image.DecompressionBombWarning)  # such a texture counts as unreadable
        try:
            return _joined(list(_pieces(path, kind)))
        except Exception as error:  # parsers of damaged files raise nearly anything
            reason = one_line((str(error).splitlines() or [""])[0], 300) or type(error).__name__
            raise ValueError(f"{path}: expected a mesh in the format {kind}, but it cannot be read: {reason}") from None


def _pieces(path: Path, kind: str) -> Iterator[Soup]:
    """The instances of the file's geometries."""
    import trimesh

    data = path.read_bytes()
    data, colours = _off(data) if kind == "OFF" else (repair(data, kind), None)
    resolver = _beside(path) if kind in ("OBJ", "PLY") else None
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind.lower(), resolver=resolver, process=False)
    places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed = [(matrix, scene.geometry[name]) for matrix, name in places]
    placed = [(matrix, geometry) for matrix, geometry in placed if isinstance(geometry, trimesh.Trimesh)]
    faces = sum(len(geometry.faces) for _, geometry in placed)
    if faces > MAX_FACES:
        raise ValueError(f"at most {MAX_FACES:,} faces are allowed, got {faces:,}")
    textures = {id(texture): texture for _, geometry in placed if (texture := _texture(geometry)) is not None}
    texels = sum(texture.width * texture.height for texture in textures.values())
    if texels > MAX_TEXELS:
        raise ValueError(f"at most {MAX_TEXELS:,} texels are allowed, got {texels:,}")
    brightness: dict[int, Floats] = {}  # by id of the geometry
    for matrix, geometry in placed:
        if kind == "PLY":
            _check_ply(geometry)
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        if vertices.shape[1:] != (3,):
            raise ValueError("its vertices do not have three coordinates each")
        vertices = trimesh.transform_points(vertices, matrix)
        if id(geometry) not in brightness:
            brightness[id(geometry)] = _brightness(geometry) if colours is None else _gray(colours)
        yield Soup(vertices, np.asarray(geometry.faces, dtype=np.int64), brightness[id(geometry)])


def _beside(path: Path) -> trimesh.resolvers.Resolver:
    """Resolves the files that ``path`` names, in its folder and below."""
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        left = MAX_BYTES_BESIDE

        def absolute(self, name: str) -> Path:
            if len(name) > LONGEST_NAME:  # each of its folders is looked up
                raise ValueError(f"the name of a file has more than {LONGEST_NAME:,} characters")
            named: Path = super().absolute(name)
            if named.exists() and not named.is_file():  # reading a pipe never ends
                raise ValueError(f"{name} is no regular file")
            if named.exists():
                self.left -= named.stat().st_size
            if self.left < 0:
                raise ValueError(f"the files that it needs have more than {MAX_BYTES_BESIDE:,} bytes")
            return named

        def get(self, name: str) -> bytes:
            data: bytes = super().get(name)
            return as_utf8(data) if name.lower().endswith(".mtl") else data

    return Beside(str(path))


def _joined(pieces: list[Soup]) -> Soup:
    if not any(len(piece.faces) for piece in pieces):
        raise ValueError("it holds no faces")
    for piece in pieces:
        if not np.isfinite(piece.vertices).all():
            raise ValueError("it holds coordinates that are not finite")
        if len(piece.faces) and not (piece.faces.min() >= 0 and piece.faces.max() < len(piece.vertices)):
            raise ValueError("a face refers to a vertex that it does not hold")
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return Soup(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)]),
        np.concatenate([piece.brightness for piece in pieces]),
    )


def _brightness(geometry: trimesh.Trimesh) -> Floats:
    visual: Any = geometry.visual  # ColorVisuals or TextureVisuals, which share no interface
    count = len(geometry.vertices)
    if visual.kind == "texture":
        brightness = _material(visual.material, _texture(geometry), visual.uv, count)
        colours = visual.vertex_attributes.get("color", ())  # GLB's, which multiply
        return brightness * _gray(np.asarray(colours)) if len(colours) == count else brightness
    if visual.kind in ("vertex", "face"):
        return _gray(np.asarray(visual.vertex_colors))
    return np.full(count, BRIGHTNESS)


def _texture(geometry: trimesh.Trimesh) -> Image.Image | None:
    """The texture of its colour, if it has one."""
    material = getattr(geometry.visual, "material", None)
    names = ("baseColorTexture", "image")  # of GLB, and of MTL and PLY
    texture: Image.Image | None = next((getattr(material, name) for name in names if hasattr(material, name)), None)
    return texture


def _material(material: Any, texture: Image.Image | None, uv: Floats | None, count: int) -> Floats:
    """MTL's texture replaces the material's colour, which many files leave black; GLB's texture multiplies it."""
    import trimesh

    if isinstance(material, trimesh.visual.material.PBRMaterial):
        multiplied = factor = material.baseColorFactor
    else:
        factor, multiplied = (material.diffuse if "kd" in material.kwargs else None), None
    sampled = None if texture is None or uv is None or len(uv) != count else _sampled(texture, uv)
    if sampled is not None:
        return sampled if multiplied is None else sampled * _gray(np.asarray(multiplied)[None])
    return np.full(count, BRIGHTNESS if factor is None else _gray(np.asarray(factor)[None])[0])


def _sampled(texture: Image.Image, uv: Floats) -> Floats | None:
    gray = _shrunk(texture)
    if gray is None:
        return None
    u, v = np.nan_to_num(np.asarray(uv, dtype=np.float64), posinf=0, neginf=0).T % 1  # textures repeat; v points up
    rows, columns = gray.shape
    sampled: Floats = gray[((1 - v) * rows).astype(int) % rows, (u * columns).astype(int) % columns]
    return sampled


def _shrunk(texture: Image.Image) -> Floats | None:
    """A small version of a texture, in gray; None of one that is damaged.  The texture itself is let go."""
    if _SHRUNK not in texture.info:  # materials share textures
        try:
            small = texture.convert("RGB")
            small.thumbnail((TEXTURE, TEXTURE), Image.Resampling.BOX)
            texture.info[_SHRUNK] = _gray(np.asarray(small))
        except Exception:  # a damaged texture is ignored
            texture.info[_SHRUNK] = None
        texture.close()
    shrunk: Floats | None = texture.info[_SHRUNK]
    return shrunk


def _gray(colours: NDArray[Any]) -> Floats:
    """Gray in 0…1 of colours (..., at least 3): integers up to their type's largest, or floats in 0…1."""
    scale = np.iinfo(colours.dtype).max if colours.dtype.kind in "iu" else 1
    gray: Floats = (colours[..., :3].astype(np.float64) / scale) @ np.array(_GRAY)
    return np.nan_to_num(gray).clip(0, 1)


def _off(data: bytes) -> tuple[bytes, Floats | NDArray[np.uint8] | None]:
    """An OFF file whose polygons have at most four corners, as trimesh needs, and its vertices' colours, if any.

    Colours, which trimesh ignores, are in 0…1 or 0…255.
    """
    all_lines = (line.partition("#")[0].strip() for line in io.StringIO(as_utf8(data).decode(), newline=None))
    lines = [line for line in all_lines if line]
    keyword, *numbers = lines[0].split(maxsplit=1) if lines else [""]
    counts, *body = [*numbers, *lines[1:]] or [""]
    if keyword not in ("OFF", "COFF") or len(counts.split()) < 2:
        raise ValueError("it does not begin with OFF or COFF and the numbers of vertices and faces")
    vertices, faces = (int(count) for count in counts.split()[:2])
    if vertices < 0 or faces < 0 or len(body) < vertices + faces:
        promised = f"{vertices:,} vertices and {faces:,} faces"
        raise ValueError(f"it promises {promised}, each on a line of its own, but has {len(body):,} lines of them")
    last = body[vertices + faces - 1].split() if faces else ["0"]
    if len(last) <= int(last[0]):
        raise ValueError(f"its last face should have {last[0]} corners, and has {len(last) - 1}")
    lines = body[: vertices + faces]
    if any(int(line.split(maxsplit=1)[0]) > 4 for line in lines[vertices:]):
        corners = [(int(count), others) for count, *others in map(str.split, lines[vertices:])]
        # as numbers: a long text would be repeated for each triangle
        polygons = [[np.int64(corner) for corner in others[:count]] for count, others in corners if count >= 3]
        lines[vertices:] = [f"3 {first} {b} {c}" for first, *others in polygons for b, c in pairwise(others)]
    repaired = "\n".join(["OFF", f"{vertices} {len(lines) - vertices} 0", *lines, ""]).encode()
    if keyword == "OFF":
        return repaired, None
    colours = np.array([line.split()[3:6] for line in lines[:vertices]], dtype=np.float64)
    return repaired, colours if colours.max(initial=0) <= 1 else colours.clip(0, 255).astype(np.uint8)


def _check_ply(geometry: trimesh.Trimesh) -> None:
    for name, element in geometry.metadata.get("_ply_raw", {}).items():
        data = element.get("data")
        columns = list(data.values()) if isinstance(data, dict) else [data]
        rows = min((0 if column is None else len(column) for column in columns), default=0)
        if rows < element["length"]:
            raise ValueError(f"it promises {element['length']:,} rows of the element {name}, but has {rows:,}")
