"""See: descriptors and their glyphs, and the numbers of a cell."""

from __future__ import annotations

import io
import time
from typing import Any

import numpy as np

from ..hog.box import cell_centres, pixel_box
from ..hog.layout import channel_names
from ..inputs.boxes import Box
from ..io.descriptor_file import save_descriptor
from ..viz.pictures import edge_votes
from .messages import HogMessage, RequestError, as_request_error, glyphs
from .snippets import write_glyph_snippets, write_hog_snippets
from .store import DescriptorEntry, Store, requested_descriptor

PHOTO_GLYPHS_SIDE = 720  # pixels, about, of their longer side


def see(request: HogMessage, store: Store) -> dict[str, Any]:
    """A descriptor's shape, its glyphs, and how to make it elsewhere."""
    began = time.perf_counter()
    entry = requested_descriptor(request, store)
    source, asked = entry.source, (request.photo or request.descriptor or "", request.name, str(request.settings))
    with as_request_error():
        drawn = glyphs(source.descriptor, source.spec, PHOTO_GLYPHS_SIDE)
    if entry.reading is None:
        snippets = write_hog_snippets(request, source.path)
    else:
        snippets = write_glyph_snippets(entry.reading, template=entry.template)
    return {
        "key": store.add(entry, *(text.encode() for text in (*asked, str(request.size)))),
        "name": source.spec.name,
        "shape": list(source.descriptor.shape),
        "numbers": source.descriptor.numel(),
        "signed": source.spec.signed,
        "image_size": list(source.image_size),
        "glyphs": drawn,
        "snippets": snippets,
        "milliseconds": round(1000 * (time.perf_counter() - began), 2),
    }


def cell(entry: DescriptorEntry, row: int, col: int) -> dict[str, Any]:
    """A cell of the image in a descriptor: its histogram, its block, and their entries by name."""
    descriptor, spec, size = entry.source.descriptor, entry.source.spec, entry.source.image_size
    votes, angles = edge_votes(descriptor, spec)
    rows, cols, _ = votes.shape
    if not (0 <= row < rows and 0 <= col < cols):
        raise RequestError(
            422, f"expected a cell in row 0…{rows - 1} and column 0…{cols - 1}, got row {row}, column {col}"
        )
    height, width = spec.cell_size
    box = [col * width, row * height, min((col + 1) * width, size[1]), min((row + 1) * height, size[0])]
    centre = [(box[1] + box[3] - 1) / 2, (box[0] + box[2] - 1) / 2]
    at = [int(np.abs(along - middle).argmin()) for along, middle in zip(cell_centres(spec, size), centre, strict=True)]
    block = pixel_box(spec, size, (at[1], at[0], at[1] + 1, at[0] + 1))
    covered = block.x0 <= centre[1] <= block.x1 and block.y0 <= centre[0] <= block.y1
    values = descriptor[at[0], at[1]].tolist()
    entries = [
        {"index": index, "name": name, "value": value}
        for index, (name, value) in enumerate(zip(channel_names(spec), values, strict=True))
    ]
    return {
        "row": row,
        "col": col,
        "box": box,
        "angles": [round(float(np.degrees(angle)) % 360, 1) for angle in angles],
        "histogram": votes[row, col].tolist() if covered else None,
        "block": {"row": at[0], "col": at[1], "box": _normalised_by(block, entry)} if covered else None,
        "entries": entries if covered else [],
    }


def _normalised_by(block: Box, entry: DescriptorEntry) -> list[int]:
    """The pixels of a block, or of all cells that a cell is normalised by, x0, y0, x1, y1."""
    spec, (height, width) = entry.source.spec, entry.source.image_size
    reach = spec.normalizer.reach()
    if reach is None:
        return [0, 0, width, height]
    down, across = (reach * side for side in spec.cell_size)
    box = (
        max(0, block.x0 - across),
        max(0, block.y0 - down),
        min(width, block.x1 + across),
        min(height, block.y1 + down),
    )
    return [int(side) for side in box]


def encode_descriptor(entry: DescriptorEntry) -> bytes:
    """A descriptor as the file that `nablahog hog` writes."""
    file = io.BytesIO()
    with as_request_error():
        save_descriptor(file, entry.source.descriptor, entry.source.spec, entry.source.image_size)
    return file.getvalue()
