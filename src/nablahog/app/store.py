"""Uploads: photographs, files of descriptors, templates of detectors, and meshes; the least recently used go first.

A file is read from memory, by the same functions as the command line's; nothing of a request becomes a path.
"""

from __future__ import annotations

import hashlib
import io
import warnings
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, TypeVar

from PIL import Image
from torch import Tensor

from ..hog import HOGSpec
from ..io.arrays import is_raw, read_array, refuse_pickle
from ..io.descriptor_file import load_descriptor
from ..io.dpm_file import is_dpm_file
from ..io.images import limit_size, read_exif_focal, read_image
from ..io.input_file import InputFile
from ..io.pixels import prepare_pillow
from ..pose.vote import forget_models
from ..render import Mesh, load_mesh
from ..requests.arrays import read_stored
from ..requests.dialect import as_text
from ..requests.inversion import GlyphRequest
from ..requests.options import SIZE
from ..requests.sources import Source, from_photo, from_stored
from ..requests.templates import read_templates
from .messages import GONE, SEE_SIZE, HogMessage, InvertMessage, RequestError, as_request_error, decode_json
from .snippets import Reading, write_array_reading, write_file_reading, write_model_reading

MOST_STORED_BYTES = 2**29
MOST_SMALLER_SIZES = 4  # of a photograph, in memory
MOST_PIXELS = 24_000_000  # in a photograph
MOST_NUMBERS = 2**24  # in a descriptor
MOST_CELLS = 2**14  # in a descriptor, that the page can draw
MOST_PARTS = 64  # descriptors of one matrix
ARRAYS = (".npy", ".npz", ".mat")


@dataclass(eq=False)
class Photograph:
    """A photograph (C, H, W), float32 in 0…1, with the name of its file.

    The box is that of an object in it, the focal length that of the file, in pixels; None if unknown.
    """

    name: str
    image: Tensor
    box: tuple[float, ...] | None = None
    focal: float | None = None
    _smaller: OrderedDict[int, Tensor] = field(default_factory=OrderedDict, init=False, repr=False)
    _lock: Lock = field(default_factory=Lock, init=False, repr=False)

    def shrunk(self, side: int) -> Tensor:
        """The image with at most so many pixels on its longer side; of threads that ask at once, one computes it."""
        with self._lock:
            if side not in self._smaller:
                self._smaller[side] = limit_size(self.image, side)
            self._smaller.move_to_end(side)
            if len(self._smaller) > MOST_SMALLER_SIZES:
                self._smaller.popitem(last=False)
            return self._smaller[side]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width)."""
        return int(self.image.shape[1]), int(self.image.shape[2])

    def facts(self, key: str) -> dict[str, Any]:
        """What the page knows about it, with its id."""
        height, width = self.size
        return {"id": key, "name": self.name, "width": width, "height": height, "focal": self.focal}

    @property
    def nbytes(self) -> int:
        smaller = min(self.image.numel(), 3 * SEE_SIZE**2)
        return 4 * (self.image.numel() + MOST_SMALLER_SIZES * smaller)


@dataclass(frozen=True, eq=False)
class DescriptorEntry:
    """A descriptor of a photograph or a file, and how the file is read; with ``template``, weights of a detector."""

    source: Source
    template: bool = False
    reading: Reading | None = None

    @property
    def nbytes(self) -> int:
        photo = 0 if self.source.photo is None else self.source.photo.numel()
        return 4 * (self.source.descriptor.numel() + photo)


@dataclass(frozen=True, eq=False)
class MeshEntry:
    """A mesh, normalised, the name of its file, and the axes by which it was read, if they were given.

    ``packaged`` meshes come with nablahog, and so have no file.
    """

    name: str
    mesh: Mesh
    up: str | None = None
    front: str | None = None
    packaged: bool = False

    @property
    def nbytes(self) -> int:
        """Bytes, with the renderers that are prepared of it."""
        return 16 * sum(tensor.numel() * tensor.element_size() for tensor in (self.mesh.vertices, self.mesh.faces))


Item = TypeVar("Item", Photograph, DescriptorEntry, MeshEntry)


class Store:
    """At most ``most`` bytes of uploads, by ids of their content and a secret, so that ids cannot be guessed."""

    def __init__(self, secret: bytes, most: int = MOST_STORED_BYTES) -> None:
        self._secret, self._most = secret, most
        self._items: OrderedDict[str, Any] = OrderedDict()
        self._pinned: dict[str, Any] = {}
        self._lock = Lock()

    @property
    def nbytes(self) -> int:
        """Bytes, without what is always there."""
        return sum(item.nbytes for item in self._items.values())

    def pin(self, key: str, item: Photograph | MeshEntry) -> None:
        """Keeps something under an id of its own as long as the server runs."""
        self._pinned[key] = item

    def pinned(self, kind: type[Item]) -> dict[str, Item]:
        """The pinned objects of a kind, by id."""
        return {key: item for key, item in self._pinned.items() if isinstance(item, kind)}

    def add(self, item: Photograph | DescriptorEntry | MeshEntry, *content: bytes) -> str:
        """Keeps something, unless it is larger than all that may be kept; the same content has the same id."""
        if item.nbytes > self._most:
            raise RequestError(
                413, f"this takes {item.nbytes:,} bytes of memory, more than the {self._most:,} available"
            )
        digest = hashlib.sha256(self._secret)
        for part in (type(item).__name__.encode(), *content):
            digest.update(len(part).to_bytes(8, "big") + part)
        key = digest.hexdigest()[:24]
        with self._lock:
            dropped = [self._items.pop(key, None)]
            self._items[key] = item
            while self.nbytes > self._most:
                dropped.append(self._items.popitem(last=False)[1])
        if any(isinstance(entry, MeshEntry) for entry in dropped):
            forget_models()  # else their meshes and renderers would stay in memory
        return key

    def get(self, key: str, kind: type[Item]) -> Item:
        """The object of a kind that has this id; RequestError if there is none, or no longer."""
        with self._lock:
            if key in self._items:
                self._items.move_to_end(key)
            item = self._pinned.get(key) or self._items.get(key)
        if not isinstance(item, kind):
            raise RequestError(410, GONE)
        return item


def requested_descriptor(request: HogMessage | InvertMessage, store: Store) -> DescriptorEntry:
    """The descriptor that a request is about."""
    if (request.photo is None) == (request.descriptor is None):
        got = "neither" if request.photo is None else "both"
        raise RequestError(422, f"expected a photo or a descriptor, got {got}")
    if request.descriptor is not None:
        return store.get(request.descriptor, DescriptorEntry)
    assert request.photo is not None
    photograph, spec = store.get(request.photo, Photograph), request.spec
    photo, shrunk = photograph.shrunk(request.size), request.size < max(photograph.size)
    with as_request_error():
        try:
            _check_cells(photograph.name, photo, spec)
            source = from_photo(photograph.name, "photo", photo, spec, size=request.size, shrunk=shrunk)
        except ValueError as error:
            larger = "a larger size" if shrunk else "a larger photograph"
            raise ValueError(f"{error}; it takes {larger}, smaller cells or another preset") from None
    return DescriptorEntry(source)


def _check_cells(name: str, photo: Tensor, spec: HOGSpec) -> None:
    """Raises ValueError if the image is smaller than a cell, of which some presets make a descriptor nevertheless."""
    size = tuple(photo.shape[1:])
    if any(side < cell for side, cell in zip(size, spec.cell_size, strict=True)):
        raise ValueError(
            f"{name}: the image must hold at least one cell of {as_text(spec.cell_size)} pixels (height x width), got "
            f"an image of {as_text(size)}"
        )


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
    if file.ending not in ARRAYS:
        expected = ", ".join(ARRAYS)
        raise RequestError(422, f"{name}: expected a descriptor ({expected}), got the ending {file.ending!r}")
    template, decided_by = query.get("as") == "template", ""
    with as_request_error():
        asked = GlyphRequest(
            preset=query.get("preset") or None,
            settings=decode_json(query.get("settings") or "{}", dict[str, str]),
            image_size=SIZE.read("image_size", query["image_size"]) if query.get("image_size") else None,
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
        if source.descriptor.numel() > MOST_NUMBERS or rows * cols > MOST_CELLS:
            raise RequestError(413, f"{name}: expected at most {MOST_CELLS:,} cells, got {rows}x{cols}")
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
    }


def _descriptors(file: InputFile, request: GlyphRequest) -> tuple[list[Source], GlyphRequest, str]:
    """The descriptors in a file, those of a matrix as parts; the request that reads them; what decided it."""
    if not is_raw(file):
        return [from_stored(file.name, "", load_descriptor(file))], request, ""
    found = read_stored(file, request)
    if len(found) > MOST_PARTS:
        raise RequestError(413, f"{file}: expected at most {MOST_PARTS} descriptors, got {len(found)}")
    rows = [f"row {each.request.row}" if len(found) > 1 else "" for each in found]
    sources = [
        replace(from_stored(file.name, "", each.stored), part=row) for each, row in zip(found, rows, strict=True)
    ]
    return sources, found[0].request, found[0].decided_by


def _readings(file: InputFile, sources: list[Source], request: GlyphRequest, template: bool) -> list[Reading]:
    """How each of the sources in a file is read again."""
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
