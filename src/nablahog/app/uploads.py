"""Uploads: photographs, files of descriptors, templates of detectors, and meshes.

A file is written under a name of our own into a temporary folder, read by the same functions as the command line's, and
removed; nothing else of a request becomes a path.
"""

from __future__ import annotations

import io
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from ..cli.arguments.preset_parameters import as_text
from ..cli.inputs.arrays import ArrayOptions, FittingPreset, presets_that_fit
from ..cli.inputs.sources import Source
from ..cli.inputs.spec import SpecOptions
from ..cli.inputs.templates import read_templates
from ..io.arrays import is_raw, read_array
from ..io.descriptor_file import load_descriptor
from ..io.images import read_image
from ..io.pixels import register_heif
from ..render import load_mesh
from .errors import RequestError, named
from .requests import Settings, decoded, spec_options
from .store import DescriptorEntry, MeshEntry, Photograph, Store

MOST_PIXELS = 24_000_000  # in a photograph
MOST_NUMBERS = 2**24  # in a descriptor
MOST_CELLS = 2**14  # in a descriptor, that the page can draw
ARRAYS, MESHES = (".npy", ".npz", ".mat"), (".off", ".obj", ".ply", ".stl", ".glb")
AXES = {"", *(f"{sign}{axis}" for sign in ("", "-", "+") for axis in "xyz")}


def photograph(data: bytes, name: str, store: Store) -> dict[str, Any]:
    """Keeps a photograph of any format that the command line reads."""
    _check_pixels(data, name)
    with _as_file(data, name, "photo") as path:
        kept = Photograph(name, read_image(path))
    height, width = kept.size
    return {"id": store.add(kept, data), "name": name, "width": width, "height": height}


def _check_pixels(data: bytes, name: str) -> None:
    """Refuses, by its first bytes alone, an image of too many pixels."""
    register_heif()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            width, height = Image.open(io.BytesIO(data)).size
    except Exception:  # decoding it will say what is wrong
        return
    if width * height > MOST_PIXELS:
        raise RequestError(413, f"{name}: expected at most {MOST_PIXELS:,} pixels, got {width * height:,}")


def descriptor(data: bytes, name: str, query: Mapping[str, str], store: Store) -> dict[str, Any]:
    """Keeps the descriptor, or the templates, in a file; asks back if the file does not say what it holds."""
    ending = Path(name).suffix.lower()
    if ending not in ARRAYS:
        raise RequestError(422, f"{name}: expected a descriptor of {', '.join(ARRAYS)}")
    template = query.get("as") == "template"
    settings: dict[str, str] = decoded(query.get("settings") or "{}", Settings)
    options, size = spec_options(query.get("preset") or None, settings), _image_size(query.get("image_size"))
    arrays = ArrayOptions(size, query.get("key") or None)
    with _as_file(data, name, f"descriptor{ending}") as path:
        try:
            with named(str(path), name):
                sources = (
                    _templates(path, name, options, arrays) if template else [_source(path, name, options, arrays)]
                )
        except RequestError as error:
            if is_raw(path):
                error.answer["question"] = _question(path, arrays)
            raise
    parts = []
    for source in sources:
        rows, cols, _ = source.descriptor.shape
        if source.descriptor.numel() > MOST_NUMBERS or rows * cols > MOST_CELLS:
            raise RequestError(413, f"{name}: expected at most {MOST_CELLS:,} cells, got {rows}x{cols}")
        content = (
            data,
            source.name.encode(),
            source.spec.to_json().encode(),
            str((source.image_size, template)).encode(),
        )
        parts.append({"id": store.add(DescriptorEntry(source, template), *content), "name": source.name})
    first = sources[0]
    return {
        "id": parts[0]["id"],
        "name": name,
        "template": template,
        "parts": parts,
        "shape": list(first.descriptor.shape),
        "preset": first.spec.name,
        "image_size": list(first.image_size),
    }


def _source(path: Path, name: str, options: SpecOptions, arrays: ArrayOptions) -> Source:
    stored = arrays.read(str(path), options) if is_raw(path) else load_descriptor(path)
    return Source(name, "descriptor", stored.descriptor.float(), stored.spec, stored.image_size, None)


def _templates(path: Path, name: str, options: SpecOptions, arrays: ArrayOptions) -> list[Source]:
    return [
        Source(each.part or name, "template", each.descriptor, each.spec, each.image_size, None)
        for each in read_templates(str(path), options, arrays)
    ]


def _question(path: Path, arrays: ArrayOptions) -> dict[str, Any]:
    """The options that the command line would need, and values that would fit."""
    shape: tuple[int, ...] | None = None
    keys: list[str] | None = None
    try:
        shape = read_array(path, arrays.key).shape
    except (ValueError, OSError) as error:
        keys = re.findall(r"(\w+) \(", str(error).partition("holds")[2]) or None
    fitting = [] if shape is None else presets_that_fit(shape, arrays.image_size)
    return {
        "as": True,
        "preset": True,
        "image_size": True,
        "key": keys is not None,
        "keys": keys,
        "suggestions": [_suggestion(each) for each in fitting],
    }


def _suggestion(fitting: FittingPreset) -> dict[str, Any]:
    """A preset that fits as the fields of a form."""
    size = "" if fitting.image_size is None else as_text(fitting.image_size)
    return {"text": fitting.options, "preset": fitting.name, "image_size": size}


def mesh(data: bytes, name: str, query: Mapping[str, str], store: Store) -> dict[str, Any]:
    """Keeps the mesh in a file."""
    ending, up, front = Path(name).suffix.lower(), query.get("up", ""), query.get("front", "")
    if ending not in MESHES:
        raise RequestError(422, f"{name}: expected a model of {', '.join(MESHES)}")
    if up not in AXES or front not in AXES:
        raise RequestError(422, f"up and front are axes such as z or -y, got {up!r} and {front!r}")
    with _as_file(data, name, f"model{ending}") as path:
        kept = MeshEntry(name, load_mesh(path, up=up or None, front=front or None))
    key = store.add(kept, data, ending.encode(), up.encode(), front.encode())
    return {"id": key, "name": name, "vertices": len(kept.mesh.vertices), "faces": len(kept.mesh.faces)}


def _image_size(text: str | None) -> tuple[int, int] | None:
    if not text:
        return None
    match = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text)
    if match is None:
        raise RequestError(422, f"expected an image size as 128x64, height first, got {text[:40]!r}")
    return int(match[1]), int(match[2])


@contextmanager
def _as_file(data: bytes, name: str, own_name: str) -> Iterator[Path]:
    """The bytes in a file of a temporary folder; errors call it by the user's name."""
    with tempfile.TemporaryDirectory(prefix="nablahog-") as folder:
        path = Path(folder, own_name)
        path.write_bytes(data)
        with named(str(path), name):
            yield path
