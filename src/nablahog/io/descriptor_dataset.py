"""Descriptors of many images: a folder of Parquet files with a row for each image, as sets of features are shared.

The folder may be a URL of any store that fsspec knows, such as ``s3://bucket/photos.parquet``.  Each file is a shard,
written whole or not at all.  Its metadata has the spec, and a key that tells which images it describes.
"""

from __future__ import annotations

import glob
import hashlib
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from ..hog import HOGSpec
from ..runtime.cache import code_key
from ..runtime.text import to_unicode
from .descriptor_file import StoredDescriptor
from .files import replacing

FORMAT = 1
SCHEMA = pa.schema(
    [
        ("path", pa.string()),
        ("height", pa.int32()),
        ("width", pa.int32()),
        ("rows", pa.int32()),
        ("cols", pa.int32()),
        ("descriptor", pa.list_(pa.float32())),
        ("error", pa.string()),
    ]
)
"""``height`` and ``width`` are of the image that is described; the descriptor is row by row, cell by cell."""
KEY = b"nablahog"
CACHED = 4  # shards that are kept in memory


@dataclass(frozen=True, eq=False)
class Row:
    """An image of a data set: its path, as it was named, and its descriptor, or an error that says why it has none."""

    path: str
    stored: StoredDescriptor | None
    error: str | None = None


def shard_key(paths: Sequence[str], spec: HOGSpec, size: int) -> str:
    """A hash of the names of a shard's images, the dialect, the size that images are shrunk to, and the code."""
    facts = json.dumps([FORMAT, list(paths), spec.to_json(), size, code_key(), torch.__version__])
    return hashlib.sha256(facts.encode()).hexdigest()


def shard_name(number: int) -> str:
    """The file of a shard."""
    return f"part-{number:06d}.parquet"


def write_shard(url: str, rows: Sequence[Row], spec: HOGSpec, key: str) -> None:
    """Writes the file ``url`` whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    cells = []
    for row in rows:
        shape = (None,) * 4 if row.stored is None else (*row.stored.image_size, *row.stored.descriptor.shape[:2])
        values = None if row.stored is None else row.stored.descriptor.float().reshape(-1).numpy()
        cells.append((to_unicode(row.path), *shape, values, None if row.error is None else to_unicode(row.error)))
    about = {KEY: json.dumps({"format": FORMAT, "spec": spec.to_json(), "key": key}).encode()}
    table = pa.table([list(column) for column in zip(*cells, strict=True)], schema=SCHEMA.with_metadata(about))
    file = io.BytesIO()
    # smaller and faster than a dictionary, as floats rarely repeat
    split = {"descriptor.list.element": "BYTE_STREAM_SPLIT"}
    pq.write_table(table, file, compression="zstd", use_dictionary=False, column_encoding=split)
    system, path = fsspec.core.url_to_fs(url)
    if isinstance(system, fsspec.implementations.local.LocalFileSystem):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as local:
            local.write(file.getbuffer())
        return
    with system.open(path, "wb") as remote:  # object stores show a file only when it is whole
        remote.write(file.getbuffer())


def read_shard_key(url: str) -> str | None:
    """The key of a shard that is there and whole; else None."""
    try:
        with fsspec.open(url, "rb") as file:
            return str(json.loads(pq.read_schema(file).metadata[KEY])["key"])
    except Exception:  # missing, or damaged in any of many ways
        return None


class DescriptorDataset(Sequence[Row]):
    """The rows of a data set, each read when it is asked for.

    Args:
        url: its folder.

    Raises:
        FileNotFoundError: there is no such folder, or it holds no shard.
        ValueError: a shard is none, or they are of different dialects.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        system, path = fsspec.core.url_to_fs(url)
        self._files = sorted(str(file) for file in system.glob(f"{glob.escape(path.rstrip('/'))}/part-*.parquet"))
        if not self._files:
            raise FileNotFoundError(f"{url}: no such data set of descriptors (part-*.parquet)")
        self._system = system
        self._table = lru_cache(CACHED)(lambda shard: self._read(self._files[shard]))
        abouts = [self._read_about(file) for file in self._files]
        self._ends = np.cumsum([count for count, _ in abouts])
        specs = {text for _, text in abouts}
        if len(specs) > 1:
            raise ValueError(f"{url}: its shards are of {len(specs)} different specs")
        self.spec = HOGSpec.from_json(specs.pop())

    def _read_about(self, file: str) -> tuple[int, str]:
        try:
            with self._system.open(file, "rb") as opened:
                footer = pq.read_metadata(opened)
            return footer.num_rows, json.loads(footer.metadata[KEY])["spec"]
        except Exception as error:
            raise ValueError(f"{file}: expected a shard of descriptors: {' '.join(str(error).split())}") from None

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"there is no row {index} of {len(self)}")
        index %= len(self)
        shard = int(np.searchsorted(self._ends, index, side="right"))
        first = int(self._ends[shard - 1]) if shard else 0
        return self._row(self._table(shard), index - first)

    def remove(self) -> None:
        """Removes its shards, and the folder if nothing else is in it."""
        for file in self._files:
            self._system.rm_file(file)
        with suppress(OSError):
            self._system.rmdir(str(Path(self._files[0]).parent))

    def errors(self) -> Iterator[tuple[str, str]]:
        """The images without a descriptor, and why; descriptors are not read."""
        for file in self._files:
            table = self._read(file, ["path", "error"])
            bad = table.filter(table["error"].is_valid())
            yield from zip(bad["path"].to_pylist(), bad["error"].to_pylist(), strict=True)

    def _read(self, file: str, columns: list[str] | None = None) -> pa.Table:
        # in this thread alone: Arrow's threads read ahead into buffers of Python, and abort the process if the
        # interpreter ends meanwhile
        with self._system.open(file, "rb") as opened, pq.ParquetFile(opened, pre_buffer=False) as shard:
            return shard.read(columns, use_threads=False)

    def _row(self, table: pa.Table, number: int) -> Row:
        values = {name: table[name][number] for name in SCHEMA.names}
        path, error = values["path"].as_py(), values["error"].as_py()
        if error is not None:
            return Row(path, None, error)
        rows, cols, height, width = (values[name].as_py() for name in ("rows", "cols", "height", "width"))
        numbers: Tensor = torch.from_numpy(values["descriptor"].values.to_numpy(zero_copy_only=False).copy())
        return Row(path, StoredDescriptor(numbers.reshape(rows, cols, -1), self.spec, (height, width)))
