"""What the tests of the command share."""

from __future__ import annotations

import os
from pathlib import Path

from skimage import data
from torch import Tensor

from ..pose.common import SWIVEL, WOODEN, model

SMALL = ["--quality", "fast", "--size", "40"]
FAST = [*SMALL, "--preset", "paper", "--prior", "none"]
CHELSEA = data.chelsea()[40:280:4, 60:380:4]
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
WEDGE = "OFF\n6 5 0\n0 0 0\n2 0 0\n2 1 0\n0 1 0\n0 1 2\n2 1 2\n4 0 1 2 3\n4 3 2 5 4\n4 4 5 1 0\n3 0 3 4\n3 1 5 2\n"


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def write_off(path: Path, vertices: Tensor, faces: Tensor) -> None:
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(str, vertex)) for vertex in vertices.tolist()]
    lines += ["3 " + " ".join(map(str, face)) for face in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


def write_chairs(folder: Path) -> Path:
    """A folder with two models."""
    folder.mkdir()
    for name, seed in (("wooden", WOODEN), ("swivel", SWIVEL)):
        write_off(folder / f"{name}.off", model(seed).vertices, model(seed).faces)
    return folder
