"""Files of a cube and of a triangle, in the formats of meshes."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nablahog.render import Mesh

CORNERS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "0 0 1", "1 0 1", "1 1 1", "0 1 1"]
QUADS = ["0 1 2 3", "4 5 6 7", "0 1 5 4", "1 2 6 5", "2 3 7 6", "3 0 4 7"]
CUBE_OFF = "\n".join(["OFF", "8 6 0", *CORNERS, *(f"4 {quad}" for quad in QUADS)]) + "\n"
VERTICES_OBJ = "".join(f"v {corner}\n" for corner in CORNERS)
TRIANGLE = "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n"


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def as_bytes(export: Any) -> bytes:
    return export.encode() if isinstance(export, str) else export


def glb(header: Any, binary: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


COMPONENT_TYPES = {"|u1": 5121, "<u2": 5123, "<f4": 5126}
TYPES = {(1,): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


class Glb:
    """A GLB of one primitive, to which arrays are added; ``primitive`` and ``header`` may be changed."""

    def __init__(self, corners: Sequence[Sequence[float]], **primitive: Any) -> None:
        self.binary = b""
        self.header: dict[str, Any] = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
        self.header |= {"accessors": [], "bufferViews": []}
        self.primitive: dict[str, Any] = {"attributes": {"POSITION": self.add(np.array(corners, "<f4"))}, **primitive}
        self.header["meshes"] = [{"primitives": [self.primitive]}]

    def view(self, array: NDArray[Any]) -> int:
        """Adds bytes, and returns the number of their view."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        views = self.header["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": array.nbytes})
        self.binary += array.tobytes()
        return len(views) - 1

    def add(self, array: NDArray[Any], **more: Any) -> int:
        """Adds numbers, and returns the number of their accessor."""
        kind = {"componentType": COMPONENT_TYPES[array.dtype.str], "type": TYPES[array.shape[1:]], "count": len(array)}
        self.header["accessors"].append({**kind, "bufferView": self.view(array), **more})
        return len(self.header["accessors"]) - 1

    def data(self, **changes: Any) -> bytes:
        return glb(self.header | {"buffers": [{"byteLength": len(self.binary)}]} | changes, self.binary)


def triangle_glb(**changes: Any) -> bytes:
    """A GLB of one triangle with corners at 0, 2x and y, and ``changes`` of its header."""
    return Glb([[0, 0, 0], [2, 0, 0], [0, 1, 0]]).data(**changes)


def surface_area(mesh: Mesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    return float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)
