"""Archives and arrays on disk: what is written comes back whole, is made again where it is damaged, and is limited."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest
import torch
from numpy.typing import NDArray
from scipy.io import savemat

from nablahog.io import arrays
from nablahog.io.array_cache import SIZE_VARIABLE, cached_array
from nablahog.io.arrays import (
    LIMIT_VARIABLE,
    MAX_CHARACTERS,
    is_raw,
    naming,
    read_arrays,
    read_number_arrays,
    read_text,
    write_arrays,
)


@pytest.mark.parametrize("compressed", [False, True])
def test_round_trip(tmp_path: Path, compressed: bool) -> None:
    arrays = {"text": "ü", "list": [1.5, 2], "array": np.arange(6).reshape(2, 3), "zeros": np.zeros(10_000)}
    write_arrays(tmp_path / "a", 7, arrays, compressed=compressed)
    assert os.listdir(tmp_path) == ["a"]
    assert ((tmp_path / "a").stat().st_size < 10_000) == compressed
    result = read_arrays(tmp_path / "a", "test", ("format", *arrays))
    assert result.pop("format") == 7
    for name, array in arrays.items():
        np.testing.assert_array_equal(result[name], array)


def test_whatever_is_in_it(tmp_path: Path) -> None:
    arrays = {"a": np.arange(3.0), "b": np.array(True), "c": np.array("text"), "d": np.array([{}], dtype=object)}
    np.savez(tmp_path / "a.npz", **arrays)
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("readme.txt", "hello")
    result = read_number_arrays(tmp_path / "a.npz")
    assert list(result) == ["a", "b"]
    np.testing.assert_array_equal(result["a"], arrays["a"])
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole.replace(np.arange(3.0).tobytes(), bytes(24)))
    with pytest.raises(ValueError, match="the archive is damaged: Bad CRC"):
        read_number_arrays(tmp_path / "a.npz")
    (tmp_path / "c.npz").write_bytes(whole[:100])
    assert not is_raw(tmp_path / "c.npz")
    with pytest.raises(ValueError, match=r"expected an? archive of arrays \(.npz\), but it cannot be read"):
        read_number_arrays(tmp_path / "c.npz")


def test_a_member_that_is_no_array(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a", 1, {"x": 1})
    with zipfile.ZipFile(tmp_path / "a", "a") as archive:
        archive.writestr("y.npy", "hello")
    with pytest.raises(ValueError, match=r"^.*/a: expected a test, but y in the archive is not an array \(.npy\)$"):
        read_arrays(tmp_path / "a", "test", ("x", "y"))
    assert list(read_number_arrays(tmp_path / "a")) == ["format", "x"]


def test_texts_are_limited() -> None:
    assert read_text({"a": np.array("x" * 100)}, "a") == "x" * 100
    with pytest.raises(ValueError, match="a must be a string of at most 4,194,304 characters"):
        read_text({"a": np.array("[]," * (MAX_CHARACTERS // 3 + 1))}, "a")


@pytest.mark.parametrize("order", "<>")
def test_characters_that_unicode_lacks(tmp_path: Path, order: str) -> None:
    last, none = (np.array([number], f"{order}u4").view(f"{order}U1") for number in (0x10FFFF, 0x110000))
    write_arrays(tmp_path / "a", 1, {"x": last})
    assert read_arrays(tmp_path / "a", "test", ["x"])["x"].tolist() == ["\U0010ffff"]
    write_arrays(tmp_path / "a", 1, {"x": none})
    with pytest.raises(ValueError, match="damaged: x holds characters that Unicode lacks"):
        read_arrays(tmp_path / "a", "test", ["x"])


def test_naming() -> None:
    with pytest.raises(ValueError, match=r"^folder/file: oh$"), naming(Path("folder/file")):
        raise OverflowError("oh")


def test_the_environment_sets_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_arrays(tmp_path / "a.npz", 1, {"x": np.zeros(1000)})
    monkeypatch.setenv(LIMIT_VARIABLE, "4000")
    with pytest.raises(ValueError, match=r"more than the 4,000 allowed; the environment variable NABLAHOG_MAX_BYTES"):
        read_arrays(tmp_path / "a.npz", "file", ["x"])
    monkeypatch.setenv(LIMIT_VARIABLE, "40000")
    read_arrays(tmp_path / "a.npz", "file", ["x"])
    np.save(tmp_path / "a.npy", np.zeros(1000))
    size = (tmp_path / "a.npy").stat().st_size
    monkeypatch.setenv(LIMIT_VARIABLE, str(size))
    assert arrays.read_array(tmp_path / "a.npy", None).shape == (1000,)
    monkeypatch.setenv(LIMIT_VARIABLE, str(size - 1))
    with pytest.raises(ValueError, match=f"unpacks to {size:,} bytes"):
        arrays.read_array(tmp_path / "a.npy", None)
    monkeypatch.setenv(LIMIT_VARIABLE, "4 GB")
    with pytest.raises(ValueError, match=r"^NABLAHOG_MAX_BYTES must be a number of bytes, got '4 GB'$"):
        read_arrays(tmp_path / "a.npz", "file", ["x"])


def test_a_tensor_of_pytorch_is_refused_with_what_to_write(tmp_path: Path) -> None:
    torch.save(torch.rand(2, 2, 31), tmp_path / "d.pt")
    with pytest.raises(ValueError, match=r"numpy\.save"):
        arrays.read_array(tmp_path / "d.pt", None)


@pytest.mark.parametrize(
    ("array", "remedy"),
    [
        (np.zeros(6, np.int64), r"array\.astype\(float\)"),
        (np.zeros(6, np.uint8), "save it as PNG"),
        (np.array([{}], dtype=object), "pickled objects, which are never loaded"),
    ],
)
def test_an_array_of_other_kinds_is_refused_with_what_to_write(tmp_path: Path, array: Any, remedy: str) -> None:
    np.save(tmp_path / "d.npy", array, allow_pickle=True)
    with pytest.raises(ValueError, match=remedy):
        arrays.read_array(tmp_path / "d.npy", None)


def test_a_file_without_numbers(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", text="abc")
    savemat(tmp_path / "a.mat", {"text": "abc"})
    for name in ("a.npz", "a.mat"):
        with pytest.raises(ValueError, match=r"the file holds no array of numbers$"):
            arrays.read_array(tmp_path / name, None)


SHAPE = (3, 1000)


class Maker:
    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> NDArray[np.float32]:
        self.made += 1
        return np.arange(3000, dtype=np.float32).reshape(SHAPE)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("NABLAHOG_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv(SIZE_VARIABLE, "100")
    return tmp_path / "kind"


def test_it_is_made_once(folder: Path) -> None:
    make = Maker()
    arrays = [cached_array("kind", "key", SHAPE, make) for _ in range(3)]
    assert make.made == 1
    assert all(np.array_equal(array, make()) for array in arrays)
    assert os.listdir(folder) == ["key.array"]
    arrays[1][:] = 7  # of the process, not the file
    assert np.array_equal(cached_array("kind", "key", SHAPE, make), make())
    cached_array("kind", "other", SHAPE, make)
    assert len(os.listdir(folder)) == 2


def test_where_there_is_no_cache_it_is_made_each_time(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = Maker()
    monkeypatch.setenv(SIZE_VARIABLE, "0")
    cached_array("kind", "key", SHAPE, make)
    monkeypatch.setenv(SIZE_VARIABLE, "100")
    with monkeypatch.context() as homeless:
        homeless.delenv("NABLAHOG_CACHE_DIR")
        homeless.setattr(platformdirs, "user_cache_path", lambda name: Path("~/.cache") / name)
        assert np.array_equal(cached_array("kind", "key", SHAPE, make), make())
    assert make.made == 3
    assert not folder.exists()


@pytest.mark.parametrize(
    ("key", "damage"),
    [
        ("key", lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:]),
        ("key", lambda data: data[:5000]),
        ("key", lambda data: b""),
        ("key", lambda data: data + b"more"),
        ("another", lambda data: data),  # renamed
    ],
)
def test_what_is_damaged_is_made_again(folder: Path, key: str, damage: Callable[[bytes], bytes]) -> None:
    make = Maker()
    cached_array("kind", "key", SHAPE, make)
    (folder / f"{key}.array").write_bytes(damage((folder / "key.array").read_bytes()))
    made = make.made
    assert np.array_equal(cached_array("kind", key, SHAPE, make), make())
    assert make.made == made + 2
    cached_array("kind", key, SHAPE, make)
    assert make.made == made + 2


def test_what_was_not_used_for_longest_is_removed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SIZE_VARIABLE, "0.055")  # four arrays of 12 kB, of which 0.8 are kept
    make = Maker()
    for number in range(4):
        cached_array("kind", str(number), SHAPE, make)
        os.utime(folder / f"{number}.array", (1000 + number, 1000 + number))
    cached_array("kind", "0", SHAPE, make)  # used just now
    cached_array("kind", "4", SHAPE, make)
    assert sorted(os.listdir(folder)) == ["0.array", "3.array", "4.array"]


def test_arrays_of_just_the_size_that_is_allowed_stay(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = Maker()
    monkeypatch.setenv(SIZE_VARIABLE, str(2 * (32 + make().nbytes) / 1e6))
    for key in ("0", "1"):
        cached_array("kind", key, SHAPE, make)
    assert sorted(os.listdir(folder)) == ["0.array", "1.array"]
