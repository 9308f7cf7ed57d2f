"""Archives of many meshes, and the chairs that come with the package in one."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from ..io.arrays import check_format, naming, read_arrays, text, write_arrays
from .mesh import Mesh

FILE = Path(__file__).parents[1] / "io" / "chairs.npz"
_FORMAT = 1
_ARRAYS = ("format", "names", "ends", "vertices", "faces", "brightness")


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
    return dict(load_meshes(FILE))


@lru_cache
def load_meshes(path: Path) -> dict[str, Mesh]:
    """The meshes by name that :func:`save_meshes` wrote, read once.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such archive, or is damaged.
    """
    arrays = read_arrays(path, "mesh archive", _ARRAYS)
    with naming(path):
        check_format(arrays, "mesh archive", _FORMAT)
        ends = arrays["ends"].astype(np.int64)
        numbers = zip(*(np.split(arrays[name], ends[:-1, k]) for k, name in enumerate(_ARRAYS[3:])), strict=True)
        meshes = (Mesh(v.astype(np.float64), f.astype(np.int64), b.astype(np.float64)) for v, f, b in numbers)
        return dict(zip(json.loads(text(arrays, "names")), meshes, strict=True))


def save_meshes(path: str | os.PathLike[str], meshes: Mapping[str, Mesh], dtype: DTypeLike = np.float32) -> None:
    """Writes meshes to an .npz archive: vertices and brightness in ``dtype``, faces in 16 bits.

    Raises:
        OSError: the file cannot be written.
        OverflowError: a mesh has more than 65,536 vertices.
    """
    each = [(mesh.vertices.numpy(), mesh.faces.numpy(), mesh.brightness.numpy()) for mesh in meshes.values()]
    if any(len(vertices) > 2**16 for vertices, _, _ in each):
        raise OverflowError("expected meshes of at most 65,536 vertices")
    dtypes = (dtype, np.uint16, dtype)
    whole = [np.concatenate(parts).astype(of) for parts, of in zip(zip(*each, strict=True), dtypes, strict=True)]
    ends = np.cumsum([[len(part) for part in parts] for parts in each], axis=0)
    arrays = {"names": json.dumps(list(meshes)), "ends": ends, **dict(zip(_ARRAYS[3:], whole, strict=True))}
    write_arrays(path, _FORMAT, arrays, compressed=True)
