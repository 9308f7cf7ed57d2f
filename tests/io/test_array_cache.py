"""Arrays on disk: read again by later processes, made again where they are damaged, and never more than allowed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from nablahog.io.array_cache import SIZE_VARIABLE, cached_array

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


@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "longer", "renamed"])
def test_what_is_damaged_is_made_again(folder: Path, damage: str) -> None:
    make = Maker()
    cached_array("kind", "key", SHAPE, make)
    path = folder / "key.array"
    data = bytearray(path.read_bytes())
    if damage == "flip":
        data[5000] ^= 1
    elif damage == "cut":
        del data[5000:]
    elif damage == "empty":
        data.clear()
    elif damage == "longer":
        data += b"more"
    else:
        os.rename(path, folder / "another.array")
    key = "another" if damage == "renamed" else "key"
    (folder / f"{key}.array").write_bytes(data)
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
