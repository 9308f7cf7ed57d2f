"""Files of a cube and of a triangle, in the formats of meshes."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

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


def triangle_glb(**changes: Any) -> bytes:
    """A GLB of one triangle with corners at 0, 2x and y, and ``changes`` of its header."""
    binary = np.array([0, 0, 0, 2, 0, 0, 0, 1, 0], "<f4").tobytes()
    header: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "bufferView": 0, "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    return glb(header | changes, binary)
