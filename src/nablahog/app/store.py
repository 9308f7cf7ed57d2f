"""Uploads and what was computed of them, in memory, up to a bound: the oldest that nobody asked for goes first."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, TypeVar

from torch import Tensor

from ..cli.inputs.sources import Source, from_photo
from ..hog import HOGSpec
from ..io.images import limit_size
from ..render import Mesh
from .errors import GONE, RequestError
from .requests import SEE_SIZE

MOST_BYTES = 2**29
SMALLER = 4  # smaller sizes of a photograph that are kept


@dataclass(eq=False)
class Photograph:
    """A photograph.

    Attributes:
        name: of its file.
        image: (C, H, W), float32 in 0…1.
        box: of an object in it, x0, y0, x1, y1 in pixels, if one is known.
    """

    name: str
    image: Tensor
    box: tuple[float, ...] | None = None
    _shrunk: OrderedDict[int, Tensor] = field(default_factory=OrderedDict)

    @property
    def size(self) -> tuple[int, int]:
        """(height, width)."""
        return int(self.image.shape[1]), int(self.image.shape[2])

    @property
    def nbytes(self) -> int:
        """Bytes."""
        smaller = min(self.image.numel(), 3 * SEE_SIZE**2)
        return 4 * (self.image.numel() + SMALLER * smaller)

    def shrunk(self, size: int) -> Tensor:
        """The photograph with at most ``size`` pixels on its longer side."""
        if size >= max(self.size):
            return self.image
        if size not in self._shrunk:
            self._shrunk[size] = limit_size(self.image, size)
            while len(self._shrunk) > SMALLER:
                self._shrunk.popitem(last=False)
        return self._shrunk[size]


@dataclass(frozen=True, eq=False)
class DescriptorEntry:
    """A descriptor: of a photograph, of a file, or a detector's template.

    Attributes:
        source: the descriptor, its spec and size, and the photograph where it is known.
        template: whether these are the weights of a linear detector.
    """

    source: Source
    template: bool = False

    @property
    def nbytes(self) -> int:
        """Bytes."""
        photo = 0 if self.source.photo is None else self.source.photo.numel()
        return 4 * (self.source.descriptor.numel() + photo)


@dataclass(frozen=True, eq=False)
class MeshEntry:
    """A mesh, normalised.

    Attributes:
        name: of its file.
        mesh: of the model.
    """

    name: str
    mesh: Mesh

    @property
    def nbytes(self) -> int:
        """Bytes, with the renderers that are prepared of it."""
        return 16 * sum(each.numel() * each.element_size() for each in (self.mesh.vertices, self.mesh.faces))


Kept = TypeVar("Kept", Photograph, DescriptorEntry, MeshEntry)


class Store:
    """Uploads, by ids that are made of their content and a secret of this process.

    Args:
        secret: so that ids cannot be guessed.
        most: bytes in all.
    """

    def __init__(self, secret: bytes, most: int = MOST_BYTES) -> None:
        self._secret, self._most = secret, most
        self._kept: OrderedDict[str, Any] = OrderedDict()
        self._pinned: dict[str, Any] = {}
        self._lock = Lock()

    @property
    def nbytes(self) -> int:
        """Bytes, without what is always there."""
        return sum(each.nbytes for each in self._kept.values())

    def pin(self, key: str, kept: Photograph | MeshEntry) -> None:
        """Keeps something under an id of its own as long as the server runs."""
        self._pinned[key] = kept

    def pinned(self, kind: type[Kept]) -> dict[str, Kept]:
        """The pinned objects of a kind, by id."""
        return {key: each for key, each in self._pinned.items() if isinstance(each, kind)}

    def add(self, kept: Photograph | DescriptorEntry | MeshEntry, *content: bytes) -> str:
        """Keeps something; the same content has the same id.

        Raises:
            RequestError: it is larger than all that may be kept.
        """
        if kept.nbytes > self._most:
            raise RequestError(
                413, f"this takes {kept.nbytes:,} bytes of memory, more than the {self._most:,} there are"
            )
        digest = hashlib.sha256(self._secret)
        for each in (type(kept).__name__.encode(), *content):
            digest.update(len(each).to_bytes(8, "big") + each)
        key = digest.hexdigest()[:24]
        with self._lock:
            self._kept[key] = kept
            self._kept.move_to_end(key)
            while self.nbytes > self._most:
                self._kept.popitem(last=False)
        return key

    def get(self, key: str, kind: type[Kept]) -> Kept:
        """The object of a kind that has this id.

        Raises:
            RequestError: there is nothing of this kind under it, or no longer.
        """
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
            item = self._pinned.get(key) or self._kept.get(key)
        if not isinstance(item, kind):
            raise RequestError(410, GONE)
        return item


def describe_photograph(photograph: Photograph, spec: HOGSpec, size: int) -> DescriptorEntry:
    """The descriptor of a photograph that is shrunk to at most ``size`` pixels, as the command line has it."""
    photo = photograph.shrunk(size)
    return DescriptorEntry(from_photo(photograph.name, "photo", photo, spec, size=0))
