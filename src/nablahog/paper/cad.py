"""Folders of CAD models, such as PASCAL3D+'s ``CAD/chair``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..io.files import check_folder
from ..render.mesh import Mesh, load_mesh
from ..render.mesh_file import ENDINGS

_BESIDE = (".mtl", ".jpg", ".jpeg", ".png", ".bmp", ".tga")  # files that an OBJ refers to


@dataclass
class Models:
    """CAD models by name, in order; their files are read by :meth:`meshes`.

    Attributes:
        paths: their files.
        ignored: names of files without the ending of a mesh, and of folders further down.
        failed: why a file could not be read, by its model's name; set by :meth:`meshes`.
    """

    paths: dict[str, Path]
    ignored: list[str]
    failed: dict[str, str] = field(default_factory=dict)

    def meshes(self, up: str | None = None, front: str | None = None) -> Iterator[tuple[str, Mesh]]:
        """Loads one after the other with :func:`~nablahog.render.mesh.load_mesh`, and skips those that fail."""
        for name, path in self.paths.items():
            try:
                mesh = load_mesh(path, up=up, front=front)
            except (OSError, ValueError) as error:
                self.failed[name] = str(error).removeprefix(f"{path}: ")
                continue
            yield name, mesh


def read_models(folder: str | os.PathLike[str]) -> Models:
    """Lists the models in a folder and in its subfolders, which may hold an OBJ with its materials or a category each.

    A model's name is its path in the folder without the ending, or with it where two would have the same.  Hidden files
    and folders are skipped; materials and textures are not listed as ignored.

    Args:
        folder: the folder.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no model.

    >>> from pathlib import Path
    >>> Path("chairs").mkdir()
    >>> _ = Path("chairs/stool.off").write_text("OFF\\n3 1 0\\n0 0 0\\n1 0 0\\n0 0 1\\n3 0 1 2\\n")
    >>> models = nablahog.paper.cad.read_models("chairs")
    >>> [(name, len(mesh.faces)) for name, mesh in models.meshes()]
    [('stool', 1)]
    """
    folder = Path(folder)
    check_folder(folder, "CAD models")
    above = _visible(folder)
    below = [entry for inner in above if inner.is_dir() for entry in _visible(inner)]
    entries = [entry for entry in above if not entry.is_dir()] + below
    files = sorted(entry for entry in entries if entry.suffix.lower() in ENDINGS and not entry.is_dir())
    if not files:
        expected = ", ".join(ENDINGS)
        raise ValueError(f"{folder}: expected a folder of CAD models ({expected}), but it holds none")
    whole = {path: _name(path.relative_to(folder)) for path in files}
    short = {path: _name(path.relative_to(folder).with_suffix("")) for path in files}
    often = Counter(short.values())
    paths = {short[path] if often[short[path]] == 1 else whole[path]: path for path in files}
    ignored = [entry for entry in entries if entry not in whole and entry.suffix.lower() not in _BESIDE]
    return Models(dict(sorted(paths.items())), sorted(_name(entry.relative_to(folder)) for entry in ignored))


def _visible(folder: Path) -> list[Path]:
    return [entry for entry in folder.iterdir() if not entry.name.startswith(".")]


def _name(path: Path) -> str:
    return os.fsencode(path.as_posix()).decode(errors="backslashreplace")  # names in any encoding can be printed
