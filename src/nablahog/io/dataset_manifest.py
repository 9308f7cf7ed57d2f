"""The manifest of a data set of descriptors: all images that it has when it is whole, and how they are described.

It is written before the first descriptor, so that whoever reads can tell a whole data set from one that was cut short,
and whoever continues knows what is left to do.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import math
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import fsspec
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from ..hog import HOGSpec
from ..runtime.cache import code_key
from ..runtime.groups import split_by_weight
from ..runtime.text import counted, to_unicode
from .files import replacing

FORMAT = 2
MANIFEST = "_manifest"  # a Parquet file; readers of whole folders skip names that begin so
SCHEMA = pa.schema([("path", pa.string()), ("bytes", pa.int64()), ("version", pa.string()), ("shard", pa.int32())])
KEY = b"nablahog"
DESCRIBING = ("hog/", "inputs/", "io/", "jobs/describing.py", "native/", "runtime/")
"""The files of the package that make a descriptor of an image; changes of others do not end a data set."""
SHARD_BYTES = 1 << 26  # of a shard's image files: some seconds of work, which a kill may lose
UNKNOWN = "of an unknown version"
NAMED_IMAGES = 3  # of those that differ, in an error


@dataclass(frozen=True)
class ImageState:
    """An image, and the state of its file, as far as it is known: another state means that the image has changed.

    Attributes:
        path: a file or URL.
        bytes: the size of the file.
        version: the time of its last change, or what its store has for that.
    """

    path: str
    bytes: int | None = None
    version: str | None = None

    @property
    def name(self) -> str:
        """The path as text that can be written."""
        return to_unicode(self.path)

    @property
    def spelling(self) -> str:
        """The name without what changes no path, ``./`` and doubled slashes: one file may be named in several ways."""
        return self.name if "://" in self.name or self.name != self.path else str(PurePath(self.name))

    def difference(self, other: ImageState) -> str | None:
        """What both states know and differ in; None for nothing."""
        if None not in (self.bytes, other.bytes) and self.bytes != other.bytes:
            return f"{self.bytes:,} bytes, now {other.bytes:,}"
        if None not in (self.version, other.version) and self.version != other.version:
            return "its version" if "://" in self.path else "its date alone"
        return None


def _code() -> str:
    return f"{code_key(parts=DESCRIBING)}, PyTorch {torch.__version__}"


def _release() -> str:
    try:
        return version("nablahog")
    except PackageNotFoundError:  # run from its sources
        return UNKNOWN


@dataclass(frozen=True)
class Manifest:
    """What a data set consists of.

    Attributes:
        spec: of the descriptors.
        size: pixels on the longer side that images are shrunk to; 0 for full size.
        shards: the images of each file.
        code: a hash of the code that describes, and the version of PyTorch.
        release: the version of this package.
    """

    spec: HOGSpec
    size: int
    shards: tuple[tuple[ImageState, ...], ...] = ()
    code: str = field(default_factory=_code)
    release: str = field(default_factory=_release, compare=False)

    def __len__(self) -> int:
        """The number of images."""
        return sum(map(len, self.shards))

    def key(self, number: int) -> str:
        """A hash of everything that a shard depends on."""
        images = [(image.name, image.bytes, image.version) for image in self.shards[number]]
        facts = json.dumps([FORMAT, self.spec.to_json(), self.size, self.code, images])
        return hashlib.sha256(facts.encode()).hexdigest()

    def check(self, other: Manifest) -> None:
        """Raises ValueError unless the images of both are described alike."""
        parameters = [parameter.name for parameter in dataclasses.fields(HOGSpec)]
        for name in parameters:
            found, expected = getattr(self.spec, name), getattr(other.spec, name)
            if found != expected:
                what = "preset" if name == "name" else name
                raise ValueError(
                    f"it has other descriptors than asked for: their {what} is {found!r}, not {expected!r}"
                )
        if self.size != other.size:
            found, expected = (f"{size} pixels" if size else "full size" for size in (self.size, other.size))
            raise ValueError(f"it has other descriptors than asked for: of images at {found}, not at {expected}")
        if self.code != other.code:
            raise ValueError(
                f"{self._writer} wrote it, and this is {other._writer}, which may describe otherwise: the "
                "former continues it"
            )

    @property
    def _writer(self) -> str:
        code, _, pytorch = self.code.partition(", ")
        return f"nablahog {self.release} (code {code[:8]}, {pytorch})"

    def add_images(self, images: Sequence[ImageState], undescribed: Collection[str] = ()) -> Manifest:
        """This manifest with further shards for those of the images that it lacks.

        Each further shard has at most the square root of their number, rounded up, and at most :data:`SHARD_BYTES` of
        files.

        Args:
            images: all that the data set is to have.
            undescribed: the names of those of its own that have no descriptor.  They may change, which changes the key
                of their shard.

        Raises:
            ValueError: one of its own images is not among ``images``, or has changed.
        """
        inputs = {image.spelling: image for image in images}
        described = [image for shard in self.shards for image in shard]
        remaining = Counter(image.spelling for image in described)
        new = []
        for image in images:
            if remaining[image.spelling]:
                remaining[image.spelling] -= 1
            else:
                new.append(image)
        gone = list(remaining.elements())
        shards = [tuple(_update(image, inputs, undescribed) for image in shard) for shard in self.shards]
        changed = [
            f"{image.name}: {difference}"
            for image in itertools.chain(*shards)
            if (difference := image.difference(inputs.get(image.spelling, image)))
        ]
        parts = [_enumerate(gone, "not among the inputs")] if gone else []
        if gone and new:
            parts.append(f"which are named as {new[0].name}")
        parts += [_enumerate(changed, "changed")] if changed else []
        if parts:
            raise ValueError(f"it has other images than asked for: {', '.join(parts)}")
        count = math.isqrt(max(len(new) - 1, 0)) + 1
        groups = split_by_weight(new, lambda image: image.bytes or 0, most=SHARD_BYTES, count=count)
        return replace(self, shards=(*shards, *map(tuple, groups)))


def _update(image: ImageState, inputs: Mapping[str, ImageState], undescribed: Collection[str]) -> ImageState:
    """An image as it is among the inputs, where it is: with its path, and its state if it is ``undescribed``."""
    found = inputs.get(image.spelling, image)
    path = found.path if found.name == image.name else image.path
    return replace(found if image.name in undescribed else image, path=path)


def _enumerate(names: Sequence[str], how: str) -> str:
    more = ", …" if len(names) > NAMED_IMAGES else ""
    return f"{counted(len(names), 'image')} {how} ({', '.join(names[:NAMED_IMAGES])}{more})"


def write_manifest(url: str, manifest: Manifest) -> None:
    """Writes the manifest of the data set ``url``, whole or not at all; OSError if it cannot be written."""
    rows = [
        (image.name, image.bytes, image.version, number)
        for number, shard in enumerate(manifest.shards)
        for image in shard
    ]
    facts = {"format": FORMAT, "spec": manifest.spec.to_json(), "size": manifest.size, "code": manifest.code}
    facts["release"] = manifest.release
    schema = SCHEMA.with_metadata({KEY: json.dumps(facts).encode()})
    with replacing_url(f"{url}/{MANIFEST}") as file:
        table = pa.table([list(column) for column in zip(*rows, strict=True)], schema=schema)
        pq.write_table(table, file, write_page_checksum=True)


def read_manifest(url: str) -> Manifest | None:
    """The manifest of the data set ``url``; None if there is none; ValueError if it is damaged."""
    try:
        with fsspec.open(f"{url}/{MANIFEST}", "rb") as file, open_parquet(file) as parquet:
            table = parquet.read(use_threads=False)
        facts = json.loads(table.schema.metadata[KEY])
        columns = (table[name].to_pylist() for name in SCHEMA.names)
        shards: list[list[ImageState]] = [[] for _ in range(max(table["shard"].to_pylist()) + 1)]
        for path, size, version, number in zip(*columns, strict=True):
            shards[number].append(ImageState(path, size, version))
        spec = HOGSpec.from_json(facts["spec"])
        release = facts.get("release", UNKNOWN)
        return Manifest(spec, facts["size"], tuple(map(tuple, shards)), facts["code"], release)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except Exception as error:  # damaged in any of many ways
        raise ValueError(
            f"{url}/{MANIFEST}: the list of images cannot be read: {' '.join(str(error).split())}; remove this file, "
            "and the command that wrote it, repeated, writes it anew"
        ) from None


def open_parquet(file: Any) -> pq.ParquetFile:
    """A Parquet file to be read without threads, whose checksums are compared, if it has any.

    Arrow's threads read ahead into buffers of Python, and abort the process if the interpreter ends meanwhile.
    """
    return pq.ParquetFile(file, pre_buffer=False, page_checksum_verification=True)


@contextmanager
def replacing_url(url: str) -> Iterator[BinaryIO]:
    """A binary file that becomes ``url`` when the block ends, and vanishes when it fails; makes its folder."""
    system, path = fsspec.core.url_to_fs(url)
    if isinstance(system, fsspec.implementations.local.LocalFileSystem):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as local:
            yield local
            local.flush()
            os.fsync(local.fileno())  # or a power cut may leave an empty file
        return
    with tempfile.TemporaryFile() as file:
        yield file
        file.seek(0)
        with system.open(path, "wb") as remote:  # object stores show a file only when it is whole
            shutil.copyfileobj(file, remote)
