"""CAD models: folders of them, such as PASCAL3D+'s ``CAD/chair``, and the candidates of Table 2."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from ..io.files import check_folder
from ..jobs.store import digest
from ..jobs.worker import local_path
from ..render.mesh import Mesh, load_mesh, load_meshes, sample_chairs
from ..render.mesh_file import ENDINGS
from ..runtime.text import unicode_of

SCENE_CHAIRS = Path(__file__).with_name("chairs.npz")  # the chairs in the scenes of Table 2
DEEPEST = 4  # folders below the one that is named
CACHED = 256  # meshes: reading one takes longer than many searches
_BESIDE = (".mtl", ".jpg", ".jpeg", ".png", ".bmp", ".tga")  # files that an OBJ refers to


@dataclass
class Models:
    """CAD models by name, in order; their files are read by :meth:`meshes`.

    Attributes:
        paths: their files.
        ignored: names of files without the ending of a mesh.
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
    """Lists the models in a folder and below, as in ShapeNet's ``SYNSET/MODEL/models/model_normalized.obj``.

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
    >>> models = nablahog.paper.models.read_models("chairs")
    >>> [(name, len(mesh.faces)) for name, mesh in models.meshes()]
    [('stool', 1)]
    """
    folder = Path(folder)
    check_folder(folder, "CAD models")
    entries = list(_files_below(folder, DEEPEST))
    files = sorted(entry for entry in entries if entry.suffix.lower() in ENDINGS)
    if not files:
        expected = f"{', '.join(ENDINGS)}, up to {DEEPEST} folders down"
        raise ValueError(f"{folder}: expected a folder of CAD models ({expected}), but it holds none")
    whole = {path: _name(path.relative_to(folder)) for path in files}
    short = {path: _name(path.relative_to(folder).with_suffix("")) for path in files}
    often = Counter(short.values())
    paths = {short[path] if often[short[path]] == 1 else whole[path]: path for path in files}
    ignored = [entry for entry in entries if entry not in whole and entry.suffix.lower() not in _BESIDE]
    return Models(dict(sorted(paths.items())), sorted(_name(entry.relative_to(folder)) for entry in ignored))


def _files_below(folder: Path, depth: int) -> Iterator[Path]:
    for entry in folder.iterdir():
        if entry.is_dir():
            if depth and not entry.name.startswith("."):
                yield from _files_below(entry, depth - 1)
        elif not entry.name.startswith("."):
            yield entry


def _name(path: Path) -> str:
    return unicode_of(path.as_posix())


@dataclass(frozen=True)
class Model:
    """A candidate model of Table 2, whose mesh is read only in the process that needs it.

    Attributes:
        name: unique among the models of a run.
        file: of the mesh; None for a chair that comes with the package.
    """

    name: str
    file: Path | None = None

    def mesh(self) -> Mesh:
        """The mesh, cached by the process while the file does not change.

        Raises:
            OSError, ValueError: as :func:`~nablahog.render.load_mesh`.
        """
        return _mesh(self, self.digest())

    def digest(self) -> str:
        """A hash of its file; empty for a chair that comes with the package.

        Raises:
            OSError: the file cannot be read.
        """
        return "" if self.file is None else digest(local_path(self.file))


@lru_cache(CACHED)
def _mesh(model: Model, digest: str) -> Mesh:
    if model.file is None:
        return {**load_meshes(SCENE_CHAIRS), **sample_chairs()}[model.name]
    return load_mesh(local_path(model.file))


class Meshes(Mapping[str, Mesh]):
    """The meshes of models by name, each read when it is asked for."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._models = {model.name: model for model in models}

    def __getitem__(self, name: str) -> Mesh:
        return self._models[name].mesh()

    def __iter__(self) -> Iterator[str]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)


def models_in(folder: Path) -> tuple[list[Model], dict[str, str]]:
    """The models that :func:`read_models` finds in a folder, and why others could not be read, by their names.

    All are read once, so that a damaged one is reported before the work.

    Raises:
        FileNotFoundError, NotADirectoryError: as there.
        ValueError: the folder holds no model, or none that can be read.
    """
    files = read_models(folder)
    models = [Model(name, files.paths[name]) for name, _ in files.meshes()]
    if not models:
        name, reason = next(iter(files.failed.items()))
        raise ValueError(f"{folder}: no model can be read; the first: {name}: {reason}")
    return models, files.failed


def scene_chairs() -> list[Model]:
    """The 24 procedural chairs in the scenes of Table 2; :func:`nablahog.sample_chairs` has others."""
    return [Model(name) for name in load_meshes(SCENE_CHAIRS)]


def chair_library() -> list[Model]:
    """The chairs of :func:`nablahog.sample_chairs`, by the same names."""
    return [Model(name) for name in sample_chairs()]
