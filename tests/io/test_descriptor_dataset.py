"""Data sets of descriptors: what is written is read, row by row, and shards are whole or not there."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest
import torch

from nablahog import hog, presets
from nablahog.io.descriptor_dataset import DescriptorDataset, Row, read_shard_key, shard_key, shard_name, write_shard
from nablahog.io.descriptor_file import StoredDescriptor

SPEC = presets.uoctti()


def rows(count: int) -> list[Row]:
    """Of images of different sizes; the last has no descriptor."""
    made = []
    for k in range(count - 1):
        image = torch.rand(1, 1, 24 + 8 * k, 32, generator=torch.Generator().manual_seed(k))
        made.append(Row(f"{k}.png", StoredDescriptor(hog(image, SPEC)[0], SPEC, (24 + 8 * k, 32))))
    return [*made, Row("bad.png", None, "expected an image")]


def write(folder: str, of: list[Row], each: int) -> None:
    for number, start in enumerate(range(0, len(of), each)):
        write_shard(f"{folder}/{shard_name(number)}", of[start : start + each], SPEC, f"key {number}")


@pytest.mark.parametrize("store", ["folder", "memory"])
@pytest.mark.parametrize("each", [2, 10])
def test_what_is_written_is_read(tmp_path: Path, store: str, each: int) -> None:
    url = str(tmp_path / "run[1].parquet") if store == "folder" else f"memory://{tmp_path.name}-{each}/x.parquet"
    write(url, rows(6), each)
    data = DescriptorDataset(url)
    assert (len(data), data.spec) == (6, SPEC)
    for found, expected in zip(data, rows(6), strict=True):
        assert (found.path, found.error) == (expected.path, expected.error)
        if expected.stored is not None:
            assert found.stored is not None
            assert torch.equal(found.stored.descriptor, expected.stored.descriptor)
            assert found.stored.image_size == expected.stored.image_size
    assert (data[-1].error, data[4].path, [row.path for row in data[1:3]]) == (
        "expected an image",
        "4.png",
        ["1.png", "2.png"],
    )
    with pytest.raises(IndexError, match="row 6 of 6"):
        data[6]
    assert list(data.errors()) == [("bad.png", "expected an image")]


def test_others_read_it(tmp_path: Path) -> None:
    write(str(tmp_path), rows(3), 3)
    table = pq.read_table(tmp_path)
    assert table["path"].to_pylist() == ["0.png", "1.png", "bad.png"]
    assert [len(each) if each else None for each in table["descriptor"].to_pylist()] == [3 * 4 * 31, 4 * 4 * 31, None]


def test_the_key_says_what_a_shard_is_of(tmp_path: Path) -> None:
    write(str(tmp_path), rows(3), 3)
    assert read_shard_key(str(tmp_path / shard_name(0))) == "key 0"
    assert read_shard_key(str(tmp_path / shard_name(1))) is None
    (tmp_path / shard_name(1)).write_bytes((tmp_path / shard_name(0)).read_bytes()[:-9])
    assert read_shard_key(str(tmp_path / shard_name(1))) is None
    assert (
        len(
            {
                shard_key(paths, spec, size)
                for paths in (["a"], ["b"])
                for spec in (SPEC, presets.dpm())
                for size in (0, 9)
            }
        )
        == 8
    )


def test_what_is_no_data_set(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such data set"):
        DescriptorDataset(str(tmp_path))
    (tmp_path / shard_name(0)).write_bytes(b"hello")
    with pytest.raises(ValueError, match=r"part-000000.parquet: expected a shard of descriptors"):
        DescriptorDataset(str(tmp_path))
    write_shard(str(tmp_path / shard_name(0)), rows(1), SPEC, "")
    write_shard(str(tmp_path / shard_name(1)), rows(1), presets.dpm(), "")
    with pytest.raises(ValueError, match="its shards are of 2 different specs"):
        DescriptorDataset(str(tmp_path))
