"""What the server keeps in memory: photographs, descriptors and meshes; the least recently used go first."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, TypeVar

from torch import Tensor

from ..hog import HOGSpec
from ..io.images import limit_size
from ..pose.vote import forget_models
from ..render import Mesh
from ..requests.dialect import as_text
from ..requests.sources import Source, from_photo
from .messages import GONE, SEE_SIZE, HogMessage, InvertMessage, RequestError, as_request_error
from .snippets import Reading

MOST_STORED_BYTES = 2**29
MOST_SMALLER_SIZES = 4  # of a photograph, in memory


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
