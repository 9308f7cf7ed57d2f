"""Inputs as files, which the command and the page take."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import torch
import trimesh
from PIL import Image

from nablahog import Mesh

from ..table import NotApplicable
from .plain import as_bytes

TIFF, PNG = ("F", "I", "CMYK", "YCbCr", "LAB"), ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")


def file_of(value: Any) -> tuple[str, bytes]:
    """An image as a file: its ending and its bytes."""
    source = getattr(value, "fp", None)
    if isinstance(value, Image.Image) and isinstance(source, io.BytesIO):  # as it was opened
        return f".{(value.format or 'png').lower()}", source.getvalue()
    if (
        isinstance(value, np.ndarray)
        and value.dtype in (np.uint8, np.uint16, np.float32, bool)
        and value.ndim in (2, 3)
    ):
        if value.ndim == 3 and (value.shape[2] != 3 or value.dtype != np.uint8):
            value = as_bytes(value) if value.shape[2] == 3 and value.dtype == np.float32 else None
        value = None if value is None or np.ma.is_masked(value) else Image.fromarray(np.ascontiguousarray(value))
    if not isinstance(value, Image.Image) or value.mode not in (*TIFF, *PNG):
        raise NotApplicable
    file, form = io.BytesIO(), "TIFF" if value.mode in TIFF else "PNG"
    if not value.width * value.height:
        raise NotApplicable
    value.save(file, format=form)
    return f".{form.lower()}", file.getvalue()


def stored(value: Any) -> tuple[str, bytes]:
    """A descriptor as a file of NumPy or PyTorch."""
    file = io.BytesIO()
    if np.ma.is_masked(value):  # which no file holds
        raise NotApplicable
    if isinstance(value, np.ndarray):
        np.save(file, value, allow_pickle=True)
        return ".npy", file.getvalue()
    if isinstance(value, torch.Tensor) and not value.is_nested:
        torch.save(value, file)
        return ".pt", file.getvalue()
    raise NotApplicable


def mesh_file(value: Any) -> bytes:
    """A mesh as PLY, with a colour for each vertex."""
    if not isinstance(value, Mesh):
        raise NotApplicable
    levels = as_bytes(value.brightness.detach())
    colours = np.stack([levels, levels, levels, np.full_like(levels, 255)], 1)
    mesh = trimesh.Trimesh(value.vertices.detach(), value.faces, vertex_colors=colours, process=False)
    return bytes(mesh.export(file_type="ply"))
