"""The candidate models of Table 2 by name, read or made only in the process that needs them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..jobs.job_files import local_path
from ..jobs.store import digest
from ..render import Mesh, load_mesh
from .cad import read_models
from .chairs import LIBRARY, chair

CACHED = 256  # meshes: reading one takes longer than many a search


@dataclass(frozen=True)
class Model:
    """A mesh by name.

    Attributes:
        name: unique among the models of a run.
        source: its file, or the seed of a procedural chair, perhaps with its kind.
    """

    name: str
    source: Path | int | tuple[int, str]

    def mesh(self) -> Mesh:
        """The mesh, cached by the process while the file does not change.

        Raises:
            OSError, ValueError: as :func:`~nablahog.render.load_mesh`.
        """
        return _mesh(self.source, self.digest())

    def digest(self) -> str:
        """What the mesh depends on beside the code.

        Raises:
            OSError: the file cannot be read.
        """
        return digest(local_path(self.source)) if isinstance(self.source, Path) else str(self.source)


@lru_cache(CACHED)
def _mesh(source: Path | int | tuple[int, str], digest: str) -> Mesh:
    if isinstance(source, Path):
        return load_mesh(local_path(source))
    return chair(*source) if isinstance(source, tuple) else chair(source)


class Meshes(Mapping[str, Mesh]):
    """The meshes of models by name, each read or made when it is asked for."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._models = {model.name: model for model in models}

    def __getitem__(self, name: str) -> Mesh:
        return self._models[name].mesh()

    def __iter__(self) -> Iterator[str]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)


def models_in(folder: Path) -> tuple[list[Model], dict[str, str]]:
    """The models of a folder, by the names that :func:`~nablahog.paper.cad.read_models` gives them.

    All are read once, so that a damaged one is reported before the work.

    Returns:
        The models, and why the others could not be read, by their names.

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


def procedural_chairs(count: int) -> list[Model]:
    """The chairs of the first ``count`` seeds."""
    return [Model(f"chair-{seed:02d}", seed) for seed in range(count)]


def chair_library() -> list[Model]:
    """The chairs of :func:`nablahog.paper.chairs.library`, by the same names."""
    return [Model(f"{kind}-{seed}", (seed, kind)) for kind, seed in LIBRARY]
