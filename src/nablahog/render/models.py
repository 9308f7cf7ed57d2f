"""CAD models by name: those in folders, such as PASCAL3D+'s ``CAD/chair``, and in archives of meshes."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from ..io.arrays import check_format, naming, read_arrays, read_text, write_arrays
from ..io.files import check_folder
from ..runtime.errors import explain
from ..runtime.text import to_unicode
from .mesh import Mesh, load_mesh
from .mesh_file import ENDINGS

SAMPLE_CHAIRS = Path(__file__).parents[1] / "io" / "chairs.npz"

DEEPEST = 4  # folders below the one that is named
CACHED_MESHES = 1024  # meshes: reading one takes longer than many searches
_ARCHIVE = ".npz"
_FORMAT = 1  # of an archive
_ARRAYS = ("format", "names", "ends", "vertices", "faces", "brightness")
_BESIDE = (".mtl", ".jpg", ".jpeg", ".png", ".bmp", ".tga")  # files that an OBJ refers to


@dataclass(frozen=True)
class Model:
    """A CAD model, whose mesh is read only in the process that needs it.

    Attributes:
        name: unique among the models of a run.
        file: of its mesh, or an archive of meshes that has one of this name.
        up, front: axes of the file, as :func:`~nablahog.load_mesh` takes them.
    """

    name: str
    file: Path
    up: str | None = None
    front: str | None = None

    def mesh(self, file: Path | None = None) -> Mesh:
        """Reads the mesh, once in this process while its file does not change.

        Args:
            file: the copy of its file on this machine; None for the file itself.

        Raises:
            OSError, ValueError: as :func:`~nablahog.load_mesh`.
        """
        file = file or self.file
        state = file.stat()
        return _read_mesh(self, file, state.st_mtime_ns, state.st_size)


@lru_cache(CACHED_MESHES)
def _read_mesh(model: Model, file: Path, changed: int, size: int) -> Mesh:
    if file.suffix.lower() != _ARCHIVE:
        return load_mesh(file, up=model.up, front=model.front)
    meshes = load_meshes(file)
    if model.name not in meshes:
        raise ValueError(f"{file}: expected a mesh archive that has {model.name}")
    return meshes[model.name]


def archived_models(path: Path) -> list[Model]:
    """Lists the models in an archive of meshes; raises what :func:`load_meshes` does."""
    return [Model(name, path) for name in load_meshes(path)]


def read_models(
    folder: str | os.PathLike[str], *, up: str | None = None, front: str | None = None
) -> tuple[list[Model], list[str]]:
    """Lists the models in a folder and below, as in ShapeNet's ``SYNSET/MODEL/models/model_normalized.obj``.

    A model's name is its path in the folder without the ending, or with it where two would have the same.  Hidden files
    and folders are skipped.  No mesh is read yet.

    Args:
        folder: the folder.
        up, front: axes of all files, as :func:`~nablahog.load_mesh` takes them.

    Returns:
        The models, sorted by name, and the names of other files, without those of materials and textures.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no model.

    >>> from pathlib import Path
    >>> Path("chairs").mkdir()
    >>> _ = Path("chairs/stool.off").write_text("OFF\\n3 1 0\\n0 0 0\\n1 0 0\\n0 0 1\\n3 0 1 2\\n")
    >>> models, others = nablahog.render.models.read_models("chairs")
    >>> [(model.name, len(model.mesh().faces)) for model in models], others
    ([('stool', 1)], [])
    """
    folder = Path(folder)
    check_folder(folder, "CAD models")
    files_below = list(_list_files(folder, DEEPEST))
    files = sorted(file for file in files_below if file.suffix.lower() in ENDINGS)
    if not files:
        expected = f"{', '.join(ENDINGS)}, up to {DEEPEST} folders down"
        raise ValueError(f"{folder}: expected a folder of CAD models ({expected}), but it holds none")
    whole = {path: _name(path.relative_to(folder)) for path in files}
    short = {path: _name(path.relative_to(folder).with_suffix("")) for path in files}
    count = Counter(short.values())
    paths = {short[path] if count[short[path]] == 1 else whole[path]: path for path in files}
    ignored = [file for file in files_below if file not in whole and file.suffix.lower() not in _BESIDE]
    models = [Model(name, path, up, front) for name, path in sorted(paths.items())]
    return models, sorted(_name(file.relative_to(folder)) for file in ignored)


def _list_files(folder: Path, depth: int) -> Iterator[Path]:
    for entry in folder.iterdir():
        if entry.is_dir():
            if depth and not entry.name.startswith("."):
                yield from _list_files(entry, depth - 1)
        elif not entry.name.startswith("."):
            yield entry


def _name(path: Path) -> str:
    return to_unicode(path.as_posix())


def check_models(
    models: Sequence[Model], progress: Callable[[int, int, str], None] = lambda done, total, what: None
) -> tuple[list[Model], dict[str, str]]:
    """Reads all models once, so that a damaged one is reported before the work.

    Returns:
        Those that can be read, and why others cannot, by their names.

    Raises:
        ValueError: none can be read.
    """
    failed = {}
    for number, model in enumerate(models, 1):
        try:
            model.mesh()
        except (OSError, ValueError) as error:
            failed[model.name] = explain(error).removeprefix(f"{model.file}: ")
        progress(number, len(models), f"reading {model.name}")
    readable = [model for model in models if model.name not in failed]
    if not readable:
        first = "no model can be read; the first: " if len(models) > 1 else ""
        raise ValueError(f"{first}{models[0].file}: {failed[models[0].name]}")
    return readable, failed


def sample_chairs() -> dict[str, Mesh]:
    """40 chairs of fifteen kinds by name: models to search among where no others are given.

    They are procedural, made by ``examples/chairs``, and under the licence of the package.

    Returns:
        Normalised meshes in the object's frame (z up, front to -y) of closed solids, which overlap where they meet; the
        same objects each time.  A name is the kind and a number, as ``"swivel-2"``.  Stools have no back, and look the
        same from several sides.

    >>> chairs = nablahog.sample_chairs()
    >>> len(chairs), list(chairs)[:2]
    (40, ['wooden-0', 'wooden-1'])
    >>> mesh = chairs["swivel-2"]
    >>> round(float((mesh.vertices.amax(0) - mesh.vertices.amin(0)).norm()), 5)  # the diagonal of its bounding box
    1.0
    """
    return dict(load_meshes(SAMPLE_CHAIRS))


@lru_cache
def load_meshes(path: Path) -> dict[str, Mesh]:
    """The meshes by name that :func:`save_meshes` wrote, read once.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not such an archive, or is damaged.
    """
    arrays = read_arrays(path, "mesh archive", _ARRAYS)
    with naming(path):
        check_format(arrays, "mesh archive", _FORMAT)
        ends = arrays["ends"].astype(np.int64)
        numbers = zip(*(np.split(arrays[name], ends[:-1, k]) for k, name in enumerate(_ARRAYS[3:])), strict=True)
        meshes = (Mesh(v.astype(np.float64), f.astype(np.int64), b.astype(np.float64)) for v, f, b in numbers)
        return dict(zip(json.loads(read_text(arrays, "names")), meshes, strict=True))


def save_meshes(path: str | os.PathLike[str], meshes: Mapping[str, Mesh], dtype: DTypeLike = np.float32) -> None:
    """Writes meshes to an .npz archive: vertices and brightness in ``dtype``, faces in 16 bits.

    Raises:
        OSError: the file cannot be written.
        OverflowError: a mesh has more than 65,536 vertices.
    """
    arrays_of_meshes = [
        (mesh.vertices.numpy(), mesh.faces.numpy(), mesh.brightness.numpy()) for mesh in meshes.values()
    ]
    if any(len(vertices) > 2**16 for vertices, _, _ in arrays_of_meshes):
        raise OverflowError("expected meshes of at most 65,536 vertices")
    dtypes = (dtype, np.uint16, dtype)
    whole = [
        np.concatenate(parts).astype(kind)
        for parts, kind in zip(zip(*arrays_of_meshes, strict=True), dtypes, strict=True)
    ]
    ends = np.cumsum([[len(part) for part in parts] for parts in arrays_of_meshes], axis=0)
    arrays = {"names": json.dumps(list(meshes)), "ends": ends, **dict(zip(_ARRAYS[3:], whole, strict=True))}
    write_arrays(path, _FORMAT, arrays, compressed=True)
