"""The files that a mesh file names: libraries of materials, buffers, and textures."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from PIL import Image

from ..inputs.pil_images import has_8_bits, pixel_values, tiff_tags
from ..io.files import local_name
from .soup import Floats, as_utf8, to_gray

MAX_BYTES_BESIDE = 2**29  # of all files that another names
LONGEST_NAME = 1000  # characters of the name of such a file
MAX_FOLDERS = 8  # folders of another machine that are looked for here
MAX_TEXELS = 2**28  # of all textures of a file: more take too long to decode
TEXTURE = 64  # side that textures are shrunk to, in texels: vertices are farther apart than finer details

_SHAPENET_TEXTURES = "images"  # ShapeNet's folder of textures, beside that of the mesh
# of MTL's maps: a name, and then numbers, switches or a channel
_OPTIONS = re.compile(r"^\s*(?:-[a-z]+(?:\s+(?:[-+.\d]+(?:e[-+]?\d+)?|on|off|[rgbmlz]))+\s+)*", re.IGNORECASE)
_LIBRARY = re.compile(r"\S.*?\.mtl(?=\s|$)", re.IGNORECASE)


class CompanionFiles:
    """The files in a mesh's folder and below, and in ShapeNet's folder of textures; none for a mesh without a folder.

    Each texture is read once.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = None if folder is None else folder.resolve()
        self._bytes, self._texels = 0, 0  # read so far
        self._textures: dict[str, Floats | None] = {}

    def read(self, name: str) -> bytes:
        """The file of a name; raises OSError or ValueError if there is none, or it may not be read."""
        if self._folder is None:
            raise FileNotFoundError(f"{name} is not there")
        path = (self._folder / _find(self._folder, name)).resolve()
        if not any(path.is_relative_to(folder) for folder in (self._folder, self._folder.parent / _SHAPENET_TEXTURES)):
            raise ValueError(f"{name} is not in the folder of the mesh")
        if path.exists() and not path.is_file():  # reading a pipe never ends
            raise ValueError(f"{name} is not a regular file")
        self._bytes += path.stat().st_size
        if self._bytes > MAX_BYTES_BESIDE:
            raise ValueError(f"the files that it needs have more than {MAX_BYTES_BESIDE:,} bytes")
        return path.read_bytes()

    def read_libraries(self, line: str) -> bytes:
        """The MTL file of this name, or those that the line names, in UTF-8; what cannot be read is left out."""
        for names in ([line], _LIBRARY.findall(line[:LONGEST_NAME])):
            libraries = []
            for name in names:
                with suppress(OSError, ValueError):
                    libraries.append(as_utf8(self.read(name)))
            if libraries:
                return b"\n".join(libraries)
        return b""

    def sample(self, name: str, places: Floats, read: Callable[[], bytes] | None = None) -> Floats | None:
        """The brightness of a texture at places.

        Args:
            name: of its file, or another by which it is known.
            places: (N, 2), v upwards; textures repeat.
            read: returns its file, if it is in no file of its own.

        Returns:
            (N,) in 0…1; None if it cannot be read.

        Raises:
            ValueError: all textures together have more than :data:`MAX_TEXELS` texels.
        """
        if name not in self._textures:
            self._textures[name] = self._small_texture(read or (lambda: self.read(name)))
        gray = self._textures[name]
        if gray is None:
            return None
        u, v = np.nan_to_num(np.asarray(places, dtype=np.float64), posinf=0, neginf=0).T % 1
        rows, columns = gray.shape
        sampled: Floats = gray[((1 - v) * rows).astype(int) % rows, (u * columns).astype(int) % columns]
        return sampled

    def _small_texture(self, read: Callable[[], bytes]) -> Floats | None:
        """A texture in gray, at most :data:`TEXTURE` texels high and wide; None if it cannot be read."""
        try:
            texture: Image.Image = Image.open(io.BytesIO(read()))
        except Exception:  # decoders of damaged files raise nearly anything
            return None
        self._texels += texture.width * texture.height
        if self._texels > MAX_TEXELS:
            raise ValueError(f"at most {MAX_TEXELS:,} texels are allowed, got {self._texels:,}")
        try:
            if has_8_bits(texture):
                texture = texture.convert("RGB")
            else:  # which convert() would clip
                texture = Image.fromarray(np.concatenate(list(pixel_values(texture, tiff_tags(texture))))[..., 0])
            texture.thumbnail((TEXTURE, TEXTURE), Image.Resampling.BOX)
            small = np.asarray(texture)
            return to_gray(small if small.ndim == 3 else small[..., None].repeat(3, axis=2))
        except Exception:
            return None


def _find(folder: Path, name: str) -> str:
    """The file in ``folder``, or below, that a material names: as it is, or as other systems and programs write it.

    That is with options before it, in quotes, with backslashes, in other cases, or in a folder of another machine.  A
    picture in ShapeNet's folder of them, beside that of the mesh, counts as below.
    """
    if len(name) > LONGEST_NAME:  # each of its folders is looked up
        raise ValueError(f"the name of a file has more than {LONGEST_NAME:,} characters")
    name = local_name(name)
    plain = _OPTIONS.sub("", name).strip().strip('"').replace("\\", "/")
    parts = [part for part in local_name(unquote(plain)).split("/") if part not in ("", ".", "..")][-MAX_FOLDERS:]
    for candidate in (name, plain, *("/".join(parts[start:]) for start in range(len(parts)))):
        with suppress(OSError, ValueError):  # a name too long, or with a null byte
            if (folder / candidate).is_file():
                return candidate
    return {entry.name.lower(): entry.name for entry in folder.iterdir()}.get(parts[-1].lower() if parts else "", plain)
