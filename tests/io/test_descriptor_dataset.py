"""Data sets of descriptors: what is written is read, row by row, and one that is not whole is refused."""

from __future__ import annotations

import pickle
import random
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import torch

from nablahog import hog, presets
from nablahog.io import dataset_manifest, descriptor_dataset
from nablahog.io.dataset_manifest import MANIFEST, ImageState, Manifest, read_manifest, write_manifest
from nablahog.io.descriptor_dataset import DescriptorDataset, Row, find_shards, shard_name, write_shard
from nablahog.io.descriptor_file import StoredDescriptor

SPEC = presets.uoctti()


def rows(count: int) -> list[Row]:
    """Of images of different sizes; the last has no descriptor."""
    made = []
    for k in range(count - 1):
        image = torch.rand(1, 1, 24 + 8 * k, 32, generator=torch.Generator().manual_seed(k))
        made.append(Row(f"{k}.png", StoredDescriptor(hog(image, SPEC)[0], SPEC, (24 + 8 * k, 32))))
    return [*made, Row("bad.png", None, "expected an image")]


def write(url: str, written: list[Row], count: int) -> Manifest:
    """Writes a data set with ``count`` rows in each shard."""
    parts = [written[start : start + count] for start in range(0, len(written), count)]
    manifest = Manifest(SPEC, 0, tuple(tuple(ImageState(row.path) for row in part) for part in parts))
    write_manifest(url, manifest)
    for number, part in enumerate(parts):
        write_shard(f"{url}/{shard_name(number)}", part, SPEC, manifest.key(number))
    return manifest


@pytest.mark.parametrize("store", ["folder", "memory"])
@pytest.mark.parametrize("count", [2, 10])
def test_what_is_written_is_read(tmp_path: Path, store: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(descriptor_dataset, "GROUP_BYTES", 20_000)  # of the first three rows of rows(6)
    url = str(tmp_path / "run[1].parquet") if store == "folder" else f"memory://{tmp_path.name}-{count}/x.parquet"
    manifest = write(url, rows(6), count)
    assert read_manifest(url) == manifest
    data: DescriptorDataset = pickle.loads(pickle.dumps(DescriptorDataset(url)))
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
    pq.write_table(
        pq.read_table(tmp_path / shard_name(0)), tmp_path / shard_name(0)
    )  # as earlier versions: no checksums
    assert [row.path for row in DescriptorDataset(str(tmp_path))] == ["0.png", "1.png", "bad.png"]


@pytest.mark.slow
def test_every_flipped_bit_is_noticed_or_changes_nothing(tmp_path: Path) -> None:
    """In pages and footer of a shard; what is noticed names the shard, or is missing to whoever completes it."""
    expected, url, shard = rows(6), str(tmp_path), tmp_path / shard_name(0)
    manifest = write(url, expected, 6)
    whole, bits, noticed = shard.read_bytes(), random.Random(0), 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[bits.randrange(len(whole))] ^= 1 << bits.randrange(8)
        shard.write_bytes(damaged)
        if find_shards(url, manifest, whole=True) == [None]:
            with pytest.raises(ValueError, match=shard.name):
                list(DescriptorDataset(url))
            noticed += 1
            continue
        found = list(DescriptorDataset(url))
        for row, same in zip(found, expected, strict=True):
            assert (row.path, row.error) == (same.path, same.error)
            if row.stored is not None and same.stored is not None:
                assert row.stored.image_size == same.stored.image_size
                assert torch.equal(row.stored.descriptor, same.stored.descriptor)
    assert noticed > 100


def test_flipped_bits_of_the_manifest(tmp_path: Path) -> None:
    """It is read as it was, or its shards are not those that it lists."""
    manifest, file, bits = write(str(tmp_path), rows(3), 2), tmp_path / MANIFEST, random.Random(0)
    whole, refused = file.read_bytes(), 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[bits.randrange(len(whole))] ^= 1 << bits.randrange(8)
        file.write_bytes(damaged)
        try:
            found = read_manifest(str(tmp_path))
        except ValueError:
            refused += 1
            continue
        assert found == manifest or None in find_shards(str(tmp_path), found or manifest)
    assert 50 < refused < 150


@pytest.mark.parametrize("damage", ["removed", "cut", "of other images", "of another spec"])
def test_a_data_set_that_is_not_whole_is_refused(tmp_path: Path, damage: str) -> None:
    """Its second shard of three is not what it was; with the right one it is read again."""
    url, shard = str(tmp_path), tmp_path / shard_name(1)
    manifest = write(url, rows(6), 2)
    whole = shard.read_bytes()
    if damage == "removed":
        shard.unlink()
    elif damage == "cut":
        shard.write_bytes(whole[:-9])
    elif damage == "of other images":
        shard.write_bytes((tmp_path / shard_name(0)).read_bytes())
    else:
        write_shard(str(shard), rows(6)[2:4], SPEC, replace(manifest, spec=presets.dpm()).key(1))
    with pytest.raises(ValueError, match=r"is not whole: 2 of 6 images are not there, those of part-000001\.parquet;"):
        DescriptorDataset(url)
    assert [found is None for found in find_shards(url, manifest)] == [False, True, False]
    shard.write_bytes(whole)
    assert DescriptorDataset(url)[2].path == "2.png"


def test_what_is_no_data_set(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such data set"):
        DescriptorDataset(str(tmp_path))
    write(str(tmp_path), rows(3), 3)
    (tmp_path / MANIFEST).rename(tmp_path / "elsewhere")
    with pytest.raises(FileNotFoundError, match=MANIFEST):
        DescriptorDataset(str(tmp_path))
    (tmp_path / MANIFEST).write_bytes((tmp_path / "elsewhere").read_bytes()[:-9])
    with pytest.raises(ValueError, match=f"{MANIFEST}: the list of images cannot be read"):
        DescriptorDataset(str(tmp_path))


def test_what_was_written_by_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(dataset_manifest, "version", version)
    with pytest.raises(ValueError, match=r"^nablahog of an unknown version \(code .* wrote it"):
        Manifest(SPEC, 0, code="other").check(Manifest(SPEC, 0))


@pytest.mark.parametrize(("count", "size", "shards"), [(1, 1, 1), (20, 1, 4), (20_000, 1, 141), (30, 10 << 20, 5)])
def test_shards_are_many_and_of_limited_size(count: int, size: int, shards: int) -> None:
    """Never more than the square root of the number of images, nor more than so many bytes of files."""
    manifest = Manifest(SPEC, 0).add_images([ImageState(f"{k}.png", size, "0") for k in range(count)])
    assert len(manifest.shards) == shards
    assert [image.path for shard in manifest.shards for image in shard] == [f"{k}.png" for k in range(count)]
    assert max(map(len, manifest.shards)) * size <= dataset_manifest.SHARD_BYTES


def test_each_shard_has_a_key_of_all_that_it_depends_on() -> None:
    manifests = [
        Manifest(spec, size, code=code).add_images([ImageState(path, 5, version)])
        for spec in (SPEC, presets.dpm())
        for size in (0, 9)
        for code in ("a", "b")
        for path in ("a.png", "b.png")
        for version in ("1", "2")
    ]
    assert len({manifest.key(0) for manifest in manifests}) == len(manifests)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([("a", 1), ("b", 1)], r"1 image not among the inputs \(c\)$"),
        ([("a", 1), ("b", 2), ("c", 1), ("d", 1)], r"1 image changed \(b: its date alone\)$"),
        ([("b", 3)], r"2 images not among the inputs \(a, c\), 1 image changed \(b: its date alone\)$"),
        ([("/x/a", 1), ("b", 1), ("c", 1)], r"1 image not among the inputs \(a\), which are named as /x/a$"),
    ],
)
def test_images_that_differ_are_named(images: list[tuple[str, int]], message: str) -> None:
    manifest = Manifest(SPEC, 0).add_images([ImageState(name, 1, "1") for name in "abc"])
    with pytest.raises(ValueError, match=message):
        manifest.add_images([ImageState(name, 1, str(version)) for name, version in images])


def test_images_may_be_spelled_otherwise() -> None:
    """And change where they have no descriptor; the names that are stored stay."""
    manifest = Manifest(SPEC, 0).add_images([ImageState(f"./{name}", 1, "1") for name in "abc"])
    assert manifest.add_images([ImageState(name, 1, "1") for name in "abc"]) == manifest
    changed = manifest.add_images([ImageState(name, 1 + (name == "c"), "2") for name in "abc"], ["./a", "./b", "./c"])
    assert [image.path for shard in changed.shards for image in shard] == ["./a", "./b", "./c"]
    assert changed.shards[1] == (ImageState("./c", 2, "2"),)
    assert not {changed.key(0), changed.key(1)} & {manifest.key(0), manifest.key(1)}


def test_new_images_come_last_in_shards_of_their_own() -> None:
    first = Manifest(SPEC, 0).add_images([ImageState(name, 1, "1") for name in "bdf"])
    second = first.add_images([ImageState(name, 1, "1") for name in "abcdef"] + [ImageState("f", 1, "1")])
    assert second.shards[: len(first.shards)] == first.shards
    assert [[image.path for image in shard] for shard in second.shards] == [["b", "d"], ["f"], ["a", "c"], ["e", "f"]]
    assert second.add_images([ImageState(name) for name in "ffabcde"]) == second  # nothing is known of their state
