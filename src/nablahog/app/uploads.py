"""Files that are sent to the server: photographs, descriptors, the weights of detectors, and meshes.

A file is read from memory, by the same functions as the command line's; nothing of a request becomes a path.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from PIL import Image

from ..io.arrays import is_raw, read_array, refuse_pickle
from ..io.descriptor_file import load_descriptor
from ..io.dpm_file import is_dpm_file
from ..io.images import read_exif_focal, read_image
from ..io.input_file import InputFile
from ..io.pixels import prepare_pillow
from ..render import load_mesh
from ..requests.arrays import read_stored
from ..requests.inversion import GlyphRequest
from ..requests.options import SIZE
from ..requests.sources import Source, from_stored
from ..requests.templates import OPENCV_ENDINGS, is_opencv_file, read_templates
from .messages import RequestError, as_request_error, decode_json
from .snippets import Reading, write_array_reading, write_detector_reading, write_file_reading, write_model_reading
from .store import DescriptorEntry, MeshEntry, Photograph, Store

MOST_PIXELS = 24_000_000  # in a photograph
MOST_NUMBERS = 2**24  # in a descriptor
MOST_CELLS = 2**14  # in a descriptor, that the page can draw
MOST_PARTS = 64  # descriptors of one matrix
ARRAYS = (".npy", ".npz", ".mat")


def store_photograph(data: bytes, name: str, _: Mapping[str, str], store: Store) -> dict[str, Any]:
    """Keeps a photograph of any format that the command line reads."""
    _check_pixels(data, name)
    file = InputFile(name, data)
    with as_request_error():
        photo = Photograph(name, read_image(file), focal=read_exif_focal(file))
    return photo.facts(store.add(photo, data))


def _check_pixels(data: bytes, name: str) -> None:
    """Refuses, by its first bytes alone, an image of too many pixels."""
    prepare_pillow()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            width, height = Image.open(io.BytesIO(data)).size
    except Exception:  # decoding it will say what is wrong
        return
    if width * height > MOST_PIXELS:
        raise RequestError(413, f"{name}: expected at most {MOST_PIXELS:,} pixels, got {width * height:,}")


def store_descriptor(data: bytes, name: str, query: Mapping[str, str], store: Store) -> dict[str, Any]:
    """Keeps the descriptor, or the templates, in a file; asks back if the file does not say what it holds."""
    file = InputFile(name, data)
    with as_request_error():
        refuse_pickle(file)
    if file.ending not in ARRAYS and not is_opencv_file(file):
        arrays, detectors = ", ".join(ARRAYS), ", ".join(OPENCV_ENDINGS)
        expected = f"a descriptor ({arrays}) or a detector that OpenCV saved ({detectors})"
        raise RequestError(422, f"{name}: expected {expected}, got the ending {file.ending!r}")
    template, decided_by = is_opencv_file(file) or query.get("as") == "template", ""
    with as_request_error():
        asked = GlyphRequest(
            preset=query.get("preset") or None,
            settings=decode_json(query.get("settings") or "{}", dict[str, str]),
            image_size=SIZE.read("the image size", query["image_size"]) if query.get("image_size") else None,
            key=query.get("key") or None,
        )
        if template:
            sources = read_templates(file, asked)
        else:
            sources, asked, decided_by = _descriptors(file, asked)
        readings = _readings(file, sources, asked, template)
    parts = []
    for source, reading in zip(sources, readings, strict=True):
        rows, cols, _ = source.descriptor.shape
        if rows * cols > MOST_CELLS:
            raise RequestError(413, f"{name}: expected at most {MOST_CELLS:,} cells, got {rows}x{cols}")
        numbers = source.descriptor.numel()
        if numbers > MOST_NUMBERS:
            raise RequestError(
                413, f"{name}: expected a descriptor of at most {MOST_NUMBERS:,} numbers, got {numbers:,}"
            )
        content = source.name, source.spec.to_json(), str((source.image_size, template))
        key = store.add(DescriptorEntry(source, template, reading), data, *map(str.encode, content))
        parts.append({"id": key, "name": source.part or source.name})
    first = sources[0]
    return {
        "id": parts[0]["id"],
        "name": name,
        "template": template,
        "parts": parts,
        "shape": list(first.descriptor.shape),
        "preset": first.spec.name,
        "image_size": list(first.image_size),
        "decided_by": decided_by,
        "remark": first.remark,
    }


def _descriptors(file: InputFile, request: GlyphRequest) -> tuple[list[Source], GlyphRequest, str]:
    """The descriptors in a file, those of a matrix as parts; the request that reads them; what decided it."""
    if not is_raw(file):
        return [from_stored(file.name, "", load_descriptor(file))], request, ""
    found = read_stored(file, request)
    if len(found) > MOST_PARTS:
        raise RequestError(413, f"{file}: expected at most {MOST_PARTS} descriptors, got {len(found)}")
    rows = [f"row {each.request.row}" if len(found) > 1 else "" for each in found]
    remark = found[0].advice.remark if found[0].advice else ""
    sources = [
        replace(from_stored(file.name, "", each.stored), part=row, remark=remark)
        for each, row in zip(found, rows, strict=True)
    ]
    return sources, found[0].request, found[0].decided_by


def _readings(file: InputFile, sources: list[Source], request: GlyphRequest, template: bool) -> list[Reading]:
    """How each of the sources in a file is read again."""
    if is_opencv_file(file):
        return [write_detector_reading(file.name)]
    if template and is_dpm_file(file):
        return [write_model_reading(file.name, number) for number in range(len(sources))]
    if not is_raw(file):
        return [write_file_reading(file.name)]
    array = read_array(file, request.key)
    if len(sources) == 1:
        return [write_array_reading(file.name, array, sources[0], request, template=template)]
    return [
        write_array_reading(file.name, array, source, replace(request, row=row), template=template)
        for row, source in enumerate(sources)
    ]


def store_mesh(data: bytes, name: str, query: Mapping[str, str], store: Store) -> dict[str, Any]:
    """Keeps the mesh in a file."""
    file, up, front = InputFile(name, data), query.get("up", ""), query.get("front", "")
    with as_request_error():
        entry = MeshEntry(name, load_mesh(file, up=up or None, front=front or None), up or None, front or None)
    key = store.add(entry, data, file.ending.encode(), up.encode(), front.encode())
    return {"id": key, "name": name, "vertices": len(entry.mesh.vertices), "faces": len(entry.mesh.faces)}
