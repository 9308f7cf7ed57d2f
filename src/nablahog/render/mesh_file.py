"""Reading untrusted mesh files: OFF, PLY and STL, and with trimesh OBJ with MTL and GLB."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..io.files import check_file, local_name
from ..io.pixels import levels
from ..runtime.text import one_line
from .glb_file import plain_glb
from .mesh_bytes import LIBRARIES, MAX_BYTES, MAX_FACES, as_utf8, plain_mtl, plain_obj
from .off_file import read_off
from .ply_file import read_ply
from .polygons import BRIGHTNESS, Floats, Soup, check_corners, gray_of
from .stl_file import read_stl

if TYPE_CHECKING:  # slow to import
    import trimesh

MAX_PLY_ROWS = 4 * MAX_FACES  # vertices, faces and edges
MAX_BYTES_BESIDE = 2**29  # of all files that another names; further ones are ignored
LONGEST_NAME = 1000  # characters of the name of such a file
DEEPEST = 8  # folders of another machine that are looked for here
MAX_TEXELS = 2**28  # of all textures of a file: more take too long to decode
TEXTURE = 64  # side that textures are shrunk to, in texels: vertices are farther apart than finer details

_FORMATS = {".off": "OFF", ".obj": "OBJ", ".ply": "PLY", ".stl": "STL", ".glb": "GLB"}
ENDINGS = tuple(_FORMATS)
# of MTL's maps: a name, and then numbers, switches or a channel
_OPTIONS = re.compile(r"^\s*(?:-[a-z]+(?:\s+(?:[-+.\d]+(?:e[-+]?\d+)?|on|off|[rgbmlz]))+\s+)*", re.IGNORECASE)
_LIBRARY = re.compile(r"\S.*?\.mtl(?=\s|$)", re.IGNORECASE)
_IMAGES = "images"  # ShapeNet's folder of textures, beside that of the mesh
# errors of parsers, and what is said instead
_NO_NUMBER = re.compile(
    r"(?:could not convert string to float|invalid literal for int\(\).*?): (?:np\.\w+\()?b?'([^']*)'"
)
_REASONS = {
    "inhomogeneous shape": "its vertices do not have three coordinates each",
    "is out of bounds for axis": "a face refers to a vertex that the file does not hold",
    "could not be read to its end": "expected numbers with decimal points",
}
_SHRUNK = (0, 0)  # the key of a texture's small version; no file can have it

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # trimesh's remarks would go to the terminal


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
        raise ValueError(f"{path}: expected a mesh file ({expected}), got the ending {path.suffix!r}")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a mesh file of more than {MAX_BYTES:,} bytes is refused")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy warns of odd numbers
        warnings.simplefilter("error", Image.DecompressionBombWarning)  # a texture too large counts as unreadable
        try:
            return _joined(list(_pieces(path, kind)))
        except Exception as error:  # parsers of damaged files raise nearly anything
            reason = _reason(error)
            raise ValueError(f"{path}: expected a mesh in the format {kind}, but it cannot be read: {reason}") from None


def _reason(error: Exception) -> str:
    text = (str(error).splitlines() or [""])[0]
    if no_number := _NO_NUMBER.search(text):
        return f"expected a number, such as -1.5, got {no_number[1]!r}"
    known = next((reason for part, reason in _REASONS.items() if part in text), None)
    return known or one_line(text, 300) or type(error).__name__


def _pieces(path: Path, kind: str) -> Iterator[Soup]:
    """The instances of the file's geometries."""
    data = path.read_bytes()
    if kind in ("OFF", "PLY", "STL"):
        if kind == "STL":
            soup = read_stl(data, MAX_FACES)
        else:
            soup = read_off(as_utf8(data).decode()) if kind == "OFF" else read_ply(data, MAX_PLY_ROWS, _sampler(path))
        _check_faces(len(soup.faces))
        yield soup
        return
    import trimesh

    data = plain_obj(data) if kind == "OBJ" else plain_glb(data)
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind.lower(), resolver=_beside(path), process=False)
    places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed = [(matrix, scene.geometry[name]) for matrix, name in places]
    placed = [(matrix, geometry) for matrix, geometry in placed if isinstance(geometry, trimesh.Trimesh)]
    faces = sum(len(geometry.faces) for _, geometry in placed)
    _check_faces(faces)
    textures = {id(texture): texture for _, geometry in placed if (texture := _texture(geometry)) is not None}
    _check_texels(list(textures.values()))
    brightness: dict[int, Floats] = {}  # by id of the geometry
    for matrix, geometry in placed:
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        if vertices.shape[1:] != (3,):
            raise ValueError("its vertices do not have three coordinates each")
        vertices = trimesh.transform_points(vertices, matrix)
        if id(geometry) not in brightness:
            brightness[id(geometry)] = _brightness(geometry)
        yield Soup(vertices, np.asarray(geometry.faces, dtype=np.int64), brightness[id(geometry)])


def _beside(path: Path) -> trimesh.resolvers.Resolver:
    """Resolves the files that ``path`` names, in its folder and below."""
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        left = MAX_BYTES_BESIDE

        def absolute(self, name: str) -> Path:
            named = (path.parent / name).resolve()
            if not named.is_relative_to(path.parent.resolve().parent / _IMAGES):
                named = super().absolute(name)
            if named.exists() and not named.is_file():  # reading a pipe never ends
                raise ValueError(f"{name} is not a regular file")
            if named.exists():
                self.left -= named.stat().st_size
            if self.left < 0:
                raise ValueError(f"the files that it needs have more than {MAX_BYTES_BESIDE:,} bytes")
            return named

        def get(self, name: str) -> bytes:
            data: bytes = super().get(_found(path.parent, name))
            return data

        def __getitem__(self, names: str) -> bytes:  # so trimesh asks for textures of GLB, and for the MTL files
            if path.suffix.lower() != ".obj":
                return self.get(names)
            return b"\n".join(filter(None, (self._library(name) for name in names.split(LIBRARIES))))

        def _library(self, name: str) -> bytes:
            """The file of this name, or those that it names; what cannot be read is left out."""
            for each in ([name], _LIBRARY.findall(name[:LONGEST_NAME])):
                found = []
                for one in each:
                    with suppress(OSError, ValueError):
                        found.append(plain_mtl(self.get(one)))
                if found:
                    return b"\n".join(found)
            return b""

    return Beside(str(path))


def _found(folder: Path, name: str) -> str:
    """The file in ``folder``, or below, that a material names: as it is, or as other systems and programs write it.

    That is with options before it, in quotes, with backslashes, in other cases, or in a folder of another machine.  A
    picture in ShapeNet's folder of them, beside that of the mesh, counts as below.
    """
    if len(name) > LONGEST_NAME:  # each of its folders is looked up
        raise ValueError(f"the name of a file has more than {LONGEST_NAME:,} characters")
    name = local_name(name)
    plain = _OPTIONS.sub("", name).strip().strip('"').replace("\\", "/")
    parts = [part for part in local_name(unquote(plain)).split("/") if part not in ("", ".", "..")][-DEEPEST:]
    for each in (name, plain, *("/".join(parts[start:]) for start in range(len(parts)))):
        with suppress(OSError, ValueError):  # a name too long, or with a null byte
            if (folder / each).is_file():
                return each
    return {entry.name.lower(): entry.name for entry in folder.iterdir()}.get(parts[-1].lower() if parts else "", plain)


def _sampler(path: Path) -> Callable[[str, Floats], Floats | None]:
    """The function that :func:`read_ply` asks for the brightness of the textures that ``path`` names."""
    beside, read = _beside(path), []

    def sample(name: str, places: Floats) -> Floats | None:
        try:
            texture = Image.open(io.BytesIO(beside[name]))
        except Exception:  # what cannot be read is ignored
            return None
        read.append(texture)
        _check_texels(read)
        return _sampled(texture, places)

    return sample


def _check_texels(textures: Sequence[Image.Image]) -> None:
    texels = sum(texture.width * texture.height for texture in textures)
    if texels > MAX_TEXELS:
        raise ValueError(f"at most {MAX_TEXELS:,} texels are allowed, got {texels:,}")


def _check_faces(count: int) -> None:
    if count > MAX_FACES:
        raise ValueError(f"at most {MAX_FACES:,} faces are allowed, got {count:,}")


def _joined(pieces: list[Soup]) -> Soup:
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


def _brightness(geometry: trimesh.Trimesh) -> Floats:
    visual: Any = geometry.visual  # ColorVisuals or TextureVisuals, which share no interface
    count = len(geometry.vertices)
    if visual.kind == "texture":
        attributes = {**geometry.vertex_attributes, **visual.vertex_attributes}
        colours = np.asarray(attributes.get("color", ()))
        return _material(
            visual.material, _texture(geometry), visual.uv, colours if len(colours) == count else None, count
        )
    if visual.kind in ("vertex", "face"):
        return gray_of(np.asarray(visual.vertex_colors))
    return np.full(count, BRIGHTNESS)


def _texture(geometry: trimesh.Trimesh) -> Image.Image | None:
    """The texture of its colour, if its file has one; trimesh makes one up where there is none."""
    material = getattr(geometry.visual, "material", None)
    names = ("baseColorTexture", "image")  # of GLB, and of MTL and PLY
    texture: Image.Image | None = next((getattr(material, name) for name in names if hasattr(material, name)), None)
    return None if texture is None or texture.format is None else texture


def _material(
    material: Any, texture: Image.Image | None, uv: Floats | None, colours: NDArray[Any] | None, count: int
) -> Floats:
    """The brightness of ``count`` vertices.

    MTL's texture replaces the colours of vertices, and these that of the material, which many files leave black.  In
    GLB all three are multiplied.
    """
    import trimesh

    sampled = None if texture is None or uv is None or len(uv) != count else _sampled(texture, uv)
    of_vertices = None if colours is None else gray_of(colours)
    if isinstance(material, trimesh.visual.material.PBRMaterial):
        factor = material.baseColorFactor
        parts = [each for each in (sampled, of_vertices) if each is not None]
        if factor is not None or not parts:
            parts.append(np.full(count, BRIGHTNESS if factor is None else gray_of(np.asarray(factor)[None])[0]))
        product: Floats = np.prod(parts, axis=0)
        return product
    if sampled is not None or of_vertices is not None:
        return sampled if sampled is not None else of_vertices  # type: ignore[return-value]
    diffuse = material.diffuse if "kd" in material.kwargs else None
    return np.full(count, BRIGHTNESS if diffuse is None else gray_of(np.asarray(diffuse)[None])[0])


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
            if texture.mode in ("I", "F") or texture.mode.startswith("I;16"):  # which convert() would clip
                texture = Image.fromarray(np.concatenate(list(levels(texture)))[..., 0])
            small = texture if texture.mode == "F" else texture.convert("RGB")
            small.thumbnail((TEXTURE, TEXTURE), Image.Resampling.BOX)
            gray = np.asarray(small)
            texture.info[_SHRUNK] = gray_of(gray if gray.ndim == 3 else gray[..., None].repeat(3, axis=2))
        except Exception:  # a damaged texture is ignored
            texture.info[_SHRUNK] = None
        texture.close()
    shrunk: Floats | None = texture.info[_SHRUNK]
    return shrunk
