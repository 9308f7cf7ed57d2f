"""Descriptors of many images: a folder of Parquet files with a row for each image, as sets of features are shared.

The folder may be a URL of any store that fsspec knows, such as ``s3://bucket/photos.parquet``.  Each file is a shard,
written whole or not at all.  Its metadata has the spec, and a key that tells which images it describes.  Which shards
there must be, the manifest says (:mod:`.dataset_manifest`).
"""

from __future__ import annotations

import bisect
import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from ..hog import HOGSpec
from ..runtime.groups import split_by_weight
from ..runtime.text import counted, one_line, to_unicode
from .dataset_manifest import FORMAT, KEY, MANIFEST, Manifest, open_parquet, read_manifest, replacing_url
from .descriptor_file import StoredDescriptor

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
GROUP_BYTES = 1 << 17  # of the descriptors in a row group, which is read as a whole: smaller ones take more space
CACHED = 4  # row groups that are kept in memory
NAMED_SHARDS = 3  # of those that are missing, in an error


@dataclass(frozen=True, eq=False)
class Row:
    """An image of a data set: its path, as it was named, and its descriptor, or an error that says why it has none."""

    path: str
    stored: StoredDescriptor | None
    error: str | None = None

    @property
    def bytes(self) -> int:
        """Of the descriptor, in memory."""
        return 0 if self.stored is None else 4 * self.stored.descriptor.numel()


def shard_name(number: int) -> str:
    """The file of a shard."""
    return f"part-{number:06d}.parquet"


def write_shard(url: str, rows: Iterable[Row], spec: HOGSpec, key: str) -> None:
    """Writes the file ``url`` whole or not at all, with few rows in memory at a time.

    Raises:
        OSError: it cannot be written.
    """
    about = {KEY: json.dumps({"format": FORMAT, "spec": spec.to_json(), "key": key}).encode()}
    schema = SCHEMA.with_metadata(about)
    # smaller and faster than a dictionary, as floats rarely repeat
    split = {"descriptor.list.element": "BYTE_STREAM_SPLIT"}
    with (
        replacing_url(url) as file,
        pq.ParquetWriter(
            file, schema, compression="zstd", use_dictionary=False, column_encoding=split, write_page_checksum=True
        ) as writer,
    ):
        for group in split_by_weight(rows, lambda row: row.bytes, most=GROUP_BYTES):
            cells = [_make_cells(row) for row in group]
            writer.write_table(pa.table([list(column) for column in zip(*cells, strict=True)], schema=schema))


def _make_cells(row: Row) -> tuple[Any, ...]:
    """The values of a row's columns."""
    if row.stored is None:
        return (to_unicode(row.path), *(None,) * 5, to_unicode(str(row.error)))
    values = row.stored.descriptor.float().reshape(-1).numpy()
    return (to_unicode(row.path), *row.stored.image_size, *row.stored.descriptor.shape[:2], values, None)


@dataclass(frozen=True)
class Shard:
    """A shard that is there and whole.

    Attributes:
        file: its path in the store.
        groups: the number of rows in each row group.
    """

    file: str
    groups: list[int]


def find_shards(url: str, manifest: Manifest, *, whole: bool = False) -> list[Shard | None]:
    """The shards of the data set ``url``; None for those that are missing, damaged, or not of these images.

    The end of each is read, or all of it if ``whole``: then no damage passes.
    """
    system, folder = fsspec.core.url_to_fs(url)
    files = [f"{folder.rstrip('/')}/{shard_name(number)}" for number in range(len(manifest.shards))]
    return [_find_shard(system, file, manifest, number, whole) for number, file in enumerate(files)]


def _find_shard(system: Any, file: str, manifest: Manifest, number: int, whole: bool) -> Shard | None:
    try:
        with system.open(file, "rb") as opened, open_parquet(opened) as shard:
            footer = shard.metadata
            groups = [footer.row_group(group).num_rows for group in range(footer.num_row_groups)]
            has_columns = shard.schema_arrow.equals(SCHEMA)  # of the footer, nothing else tells that it is whole
            key = json.loads(footer.metadata[KEY])["key"]
            if not has_columns or key != manifest.key(number) or sum(groups) != len(manifest.shards[number]):
                return None
            for group in range(len(groups)) if whole else ():
                shard.read_row_group(group, use_threads=False)
        return Shard(file, groups)
    except Exception:  # missing, or damaged in any of many ways
        return None


def find_undescribed(url: str, manifest: Manifest) -> set[str]:
    """The images of the data set ``url`` that have no descriptor: their shard is missing, or they could not be read."""
    system, _ = fsspec.core.url_to_fs(url)
    names = set()
    for shard, images in zip(find_shards(url, manifest), manifest.shards, strict=True):
        failed: Iterable[bool] = itertools.repeat(True)
        if shard is not None:
            with (
                suppress(OSError, ValueError),
                system.open(shard.file, "rb") as opened,
                open_parquet(opened) as parquet,
            ):
                failed = parquet.read(["error"], use_threads=False)["error"].is_valid().to_pylist()
        names |= {image.name for image, is_failed in zip(images, failed, strict=False) if is_failed}
    return names


class DescriptorDataset(Sequence[Row]):
    """The rows of a data set, each read when it is asked for.

    Args:
        url: its folder.

    Raises:
        FileNotFoundError: there is no such folder, or it holds no manifest.
        ValueError: the manifest is damaged, or the data set is not whole: shards are missing or damaged.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        manifest = read_manifest(url)
        if manifest is None:
            raise FileNotFoundError(
                f"{url}: no such data set of descriptors, a folder of part-*.parquet and {MANIFEST}; "
                "a column of another Parquet file is read as an array: "
                "numpy.save('v.npy', numpy.stack(pandas.read_parquet(FILE)['COLUMN']))"
            )
        self.spec = manifest.spec
        self._system, self._folder = fsspec.core.url_to_fs(url)
        self._shards = _all_shards(url, manifest)
        self._groups = [(shard.file, number) for shard in self._shards for number in range(len(shard.groups))]
        self._ends = list(itertools.accumulate(rows for shard in self._shards for rows in shard.groups))
        self._table = lru_cache(CACHED)(self._read)

    def __reduce__(self) -> tuple[type[DescriptorDataset], tuple[str]]:
        """So that workers of a ``DataLoader`` open it by themselves."""
        return DescriptorDataset, (self.url,)

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"there is no row {index} of {len(self)}")
        index %= len(self)
        group = bisect.bisect_right(self._ends, index)
        table = self._table(group)
        with self._naming(group):
            return self._row(table, index - self._first(group))

    def remove(self) -> None:
        """Removes its files, and the folder if nothing else is in it."""
        for shard in self._shards:
            self._system.rm_file(shard.file)
        self._system.rm_file(f"{self._folder.rstrip('/')}/{MANIFEST}")
        with suppress(OSError):
            self._system.rmdir(self._folder)

    def errors(self) -> Iterator[tuple[str, str]]:
        """The images without a descriptor, and why; descriptors are not read."""
        for group in range(len(self._groups)):
            table = self._read(group, ["path", "error"])
            bad = table.filter(table["error"].is_valid())
            yield from zip(bad["path"].to_pylist(), bad["error"].to_pylist(), strict=True)

    def _first(self, group: int) -> int:
        """The number of the first row of a row group."""
        return self._ends[group - 1] if group else 0

    def _read(self, group: int, columns: list[str] | None = None) -> pa.Table:
        file, number = self._groups[group]
        with self._naming(group), self._system.open(file, "rb") as opened, open_parquet(opened) as shard:
            return shard.read_row_group(number, columns, use_threads=False)

    @contextmanager
    def _naming(self, group: int) -> Iterator[None]:
        """Turns errors about damaged content into a ValueError that names the file and says how it is repaired."""
        try:
            yield
        except (OSError, ValueError, RuntimeError) as error:
            if getattr(error, "errno", None) is not None:  # of the disk or the network
                raise
            name = Path(self._groups[group][0]).name
            raise ValueError(
                f"{self.url.rstrip('/')}/{name} is damaged: rows {self._first(group)} to {self._ends[group] - 1} of "
                f"all cannot be read ({one_line(error)}); remove this file, and the command that wrote it, "
                "repeated, writes it anew"
            ) from None

    def _row(self, table: pa.Table, number: int) -> Row:
        values = {name: table[name][number] for name in SCHEMA.names}
        path, error = values["path"].as_py(), values["error"].as_py()
        if error is not None:
            return Row(path, None, error)
        rows, cols, height, width = (values[name].as_py() for name in ("rows", "cols", "height", "width"))
        numbers: Tensor = torch.from_numpy(values["descriptor"].values.to_numpy(zero_copy_only=False).copy())
        return Row(path, StoredDescriptor(numbers.reshape(rows, cols, -1), self.spec, (height, width)))


def _all_shards(url: str, manifest: Manifest) -> list[Shard]:
    """The shards of a data set; ValueError if some are missing."""
    shards = find_shards(url, manifest)
    missing = [number for number, shard in enumerate(shards) if shard is None]
    if missing:
        images = sum(len(manifest.shards[number]) for number in missing)
        names = ", ".join(map(shard_name, missing[:NAMED_SHARDS])) + (", …" if len(missing) > NAMED_SHARDS else "")
        raise ValueError(
            f"{url} is not whole: {images:,} of {counted(len(manifest), 'image')} are not there, those of {names}; "
            "the command that began it, repeated, completes it"
        )
    return [shard for shard in shards if shard is not None]
