"""Cameras, masks and meshes."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from PIL import Image

from nablahog import Camera, Mesh

from ..table import Row, rows
from .arrays import masked, spaced
from .values import LARGE


def matrix(camera: Camera, fy: float = 1.0) -> Any:
    """The camera matrix K."""
    return np.array([[camera.focal, 0, camera.width / 2], [0, fy * camera.focal, camera.height / 2], [0, 0, 1]])


def with_focal(convert: Any) -> Any:
    return lambda camera: Camera(convert(camera.focal), camera.height, camera.width)


def with_sides(convert: Any) -> Any:
    return lambda camera: Camera(camera.focal, convert(camera.height), convert(camera.width))


CAMERAS_TAKEN = {
    "focal int": with_focal(int),
    "focal np.float32": with_focal(np.float32),
    "focal np.int64": with_focal(np.int64),
    "focal tensor": with_focal(torch.tensor),
    "focal array ()": with_focal(np.array),
    "sides np.int64": with_sides(np.int64),
    "sides tensors": with_sides(torch.tensor),
}
CAMERAS_REFUSED = {
    "None": lambda c: [],
    "focal NaN": with_focal(lambda f: float("nan")),
    "focal 0": with_focal(lambda f: 0),
    "focal negative": with_focal(lambda f: -f),
    "focal a text": with_focal(str),
    "focal complex": with_focal(complex),
    "focal of two": with_focal(lambda f: np.array([f, f])),
    "sides 0": with_sides(lambda n: 0),
    "sides halves": with_sides(lambda n: n + 0.5),
    "sides texts": with_sides(str),
    "sides very large": with_sides(lambda n: LARGE),
    "sides None": with_sides(lambda n: None),
    "matrix of other pixels": lambda c: matrix(c, 3.0),
    "a function": lambda c: len,
    "a text": lambda c: "50mm",
}
CAMERAS = [
    *rows("camera", CAMERAS_TAKEN, must="be taken", tolerance=1e-4),
    Row("camera sides whole floats", "camera", with_sides(float)),
    Row("camera matrix", "camera", matrix),
    Row("camera matrix as a list", "camera", lambda c: matrix(c).tolist()),
    Row("camera matrix tensor", "camera", lambda c: torch.from_numpy(matrix(c))),
    Row("camera matrix (3, 4)", "camera", lambda c: np.hstack([matrix(c), np.zeros((3, 1))])),
    Row("camera two focal lengths", "camera", lambda c: (c.focal, c.focal)),
    Row("camera two focal lengths, array", "camera", lambda c: np.array([c.focal, c.focal])),
    Row("camera focal alone", "camera", lambda c: c.focal),
    Row("camera focal array of one", "camera", lambda c: np.array([c.focal])),
    Row("camera a dict", "camera", lambda c: {"fx": c.focal, "fy": c.focal}),
    *rows("camera", CAMERAS_REFUSED, must="be refused"),
]
MASKS_TAKEN = {
    "tensor": torch.from_numpy,
    "tensor not contiguous": lambda m: torch.from_numpy(m.T.copy()).T,
    "negative strides": lambda m: m[::-1].copy()[::-1],
    "every second column": spaced,
    "read-only": lambda m: np.broadcast_to(m, (2, *m.shape))[0],
    "masked nowhere": lambda m: masked(m, False),
}
MASKS_EITHER = {
    "uint8 0, 1": lambda m: m.astype(np.uint8),
    "uint8 0, 255": lambda m: m.astype(np.uint8) * 255,
    "float32 0, 1": lambda m: m.astype(np.float32),
    "int64": lambda m: m.astype(np.int64),
    "tensor uint8": lambda m: torch.from_numpy(m.astype(np.uint8)),
    "list": lambda m: m.tolist(),
    "objects": lambda m: m.astype(object),
    "(1, H, W)": lambda m: m[None],
    "(H, W, 1)": lambda m: m[..., None],
    "(H, W, 3)": lambda m: np.stack([m, m, m], -1),
    "PIL 1": lambda m: Image.fromarray(m),
    "PIL L": lambda m: Image.fromarray(m.astype(np.uint8) * 255),
    "PIL RGB": lambda m: Image.fromarray(m).convert("RGB"),
    "PIL P": lambda m: Image.fromarray(m).convert("P"),
    "tensor (1, H, W)": lambda m: torch.from_numpy(m)[None],
}
MASKS_REFUSED = {
    "masked somewhere": lambda m: masked(m, True),
    "false everywhere": np.zeros_like,
    "transposed": lambda m: m.T,
    "of another size": lambda m: np.pad(m, 1),
    "a path": lambda m: "mask.png",
    "a number": lambda m: 1,
    "of levels": lambda m: np.where(m, 0.5, 0.2),
    "of texts": lambda m: m.astype(str),
    "empty": lambda m: m[:0],
    "polygon": lambda m: [[2.0, 2, 30, 2, 30, 30]],
    "RLE": lambda m: {"size": list(m.shape), "counts": [3, 5]},
}
MASKS = [
    *rows("mask", MASKS_TAKEN, must="be taken"),
    *rows("mask", MASKS_EITHER),
    *rows("mask", MASKS_REFUSED, must="be refused"),
]


def parts(mesh: Mesh) -> tuple[Any, Any, Any]:
    return mesh.vertices.numpy(), mesh.faces.numpy(), mesh.brightness.numpy()


def rebuilt(*dtypes: Any) -> Any:
    """From arrays of other types."""
    return lambda mesh: Mesh(*(part.astype(kind) for part, kind in zip(parts(mesh), dtypes, strict=True)))


def of_tensors(*dtypes: torch.dtype) -> Any:
    return lambda mesh: Mesh(*(torch.from_numpy(part).to(kind) for part, kind in zip(parts(mesh), dtypes, strict=True)))


def stored(mesh: Mesh) -> Path:
    path = Path(tempfile.mkdtemp(), "mesh.ply")
    trimesh.Trimesh(*parts(mesh)[:2], process=False).export(path)
    return path


MESHES_TAKEN = {
    "arrays float32": rebuilt("f4", "i4", "f4"),
    "arrays big-endian": rebuilt(">f8", ">i8", ">f8"),
    "arrays uint32": rebuilt("f8", "u4", "f8"),
    "lists": lambda m: Mesh(*(part.tolist() for part in parts(m))),
    "tensors float32": of_tensors(torch.float32, torch.int32, torch.float32),
    "arrays Fortran order": lambda m: Mesh(*map(np.asfortranarray, parts(m))),
    "mixed": lambda m: Mesh(m.vertices.float(), m.faces.numpy(), m.brightness.tolist()),
    "requires_grad": lambda m: Mesh(m.vertices.clone().requires_grad_(), m.faces, m.brightness),
    "not contiguous": lambda m: Mesh(m.vertices.T.contiguous().T, m.faces.T.contiguous().T, m.brightness),
}
MESHES_EITHER = {
    "in a list": lambda m: [m],
    "in a tuple": lambda m: (m,),
    "by name": lambda m: {"a": m},
    "in a generator": lambda m: iter([m]),
    "vertices and faces": lambda m: parts(m)[:2],
    "of trimesh": lambda m: trimesh.Trimesh(*parts(m)[:2]),
    "brightness uint8": lambda m: Mesh(m.vertices, m.faces, (m.brightness * 255).round().to(torch.uint8)),
    "brightness of colours": lambda m: Mesh(m.vertices, m.faces, m.brightness[:, None].expand(-1, 3)),
    "faces whole floats": rebuilt("f8", "f8", "f8"),
}
MESHES_REFUSED = {
    "None": lambda m: None,
    "a path": stored,
    "a path as text": lambda m: str(stored(m)),
    "an empty list": lambda m: [],
    "an empty dict": lambda m: {},
    "no faces": lambda m: Mesh(m.vertices, m.faces[:0], m.brightness),
    "faces from -1": lambda m: Mesh(m.vertices, m.faces - 1, m.brightness),
    "brightness NaN": lambda m: Mesh(m.vertices, m.faces, m.brightness * float("nan")),
    "quads": lambda m: Mesh(m.vertices, [[0, 1, 2, 3]], m.brightness),
    "faces from 1": lambda m: Mesh(m.vertices, m.faces + 1, m.brightness),
    "complex": rebuilt("c16", "i8", "f8"),
    "faces halves": lambda m: Mesh(m.vertices, parts(m)[1] + 0.5, m.brightness),
    "vertices in the plane": lambda m: Mesh(m.vertices[:, :2], m.faces, m.brightness),
    "vertices masked": lambda m: Mesh(masked(parts(m)[0], True), m.faces, m.brightness),
    "vertices with NaN": lambda m: Mesh(m.vertices * float("nan"), m.faces, m.brightness),
    "of texts": lambda m: Mesh(parts(m)[0].astype(str), m.faces, m.brightness),
    "in a list of paths": lambda m: [stored(m)],
    "in a list with None": lambda m: [m, None],
}
MESHES = [
    *rows("mesh", MESHES_TAKEN, must="be taken", tolerance=1e-4),
    *rows("mesh", MESHES_EITHER),
    *rows("mesh", MESHES_REFUSED, must="be refused"),
]
ROWS = [*CAMERAS, *MASKS, *MESHES]
