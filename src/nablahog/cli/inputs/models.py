"""The CAD models of a command."""

from __future__ import annotations

import os
from argparse import Namespace
from pathlib import Path

from ...paper.models import Models, read_models
from ...render import Mesh, sample_chairs
from ...render.axes import axes
from ..terminal import counter, inform


def find_models(arguments: Namespace) -> Models:
    """The models of the folder ``arguments.mesh``, or the one of that file, not read yet; none for the package's own.

    Raises:
        ValueError: there is none, or ``arguments.up`` and ``front`` are no two axes.
    """
    if arguments.mesh is None:
        if arguments.up or arguments.front:
            raise ValueError("--up and --front say how the files of --mesh lie; the chairs of nablahog need neither")
        return Models({}, [])
    if arguments.up is not None:
        axes(arguments.up, arguments.front)
    path = Path(arguments.mesh)
    if path.is_dir():
        return read_models(path)
    return Models({os.fsencode(path.stem).decode(errors="backslashreplace"): path}, [])


def read_meshes(models: Models, arguments: Namespace) -> dict[str, Mesh]:
    """The meshes by name, with progress, and a line on stderr for each model that cannot be read.

    Raises:
        ValueError: that are all.
    """
    if arguments.mesh is None:
        return sample_chairs()
    name = f"nablahog {arguments.command}"
    meshes = {}
    with counter(name) as progress:
        for model, mesh in models.meshes(arguments.up, arguments.front):
            meshes[model] = mesh
            progress(len(meshes) + len(models.failed), len(models.paths), f"reading {model}")
    if not meshes:
        model, reason = next(iter(models.failed.items()))
        first = "no model can be read; the first: " if len(models.paths) > 1 else ""
        raise ValueError(f"{first}{models.paths[model]}: {reason}")
    for model, reason in (*models.failed.items(), *((other, "no model by its ending") for other in models.ignored)):
        inform(f"{name}: skipped: {model}: {reason}")
    return meshes
