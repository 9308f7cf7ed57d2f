"""MATLAB's files: what SciPy writes is read, and whatever is damaged is refused in a sentence."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import io

from nablahog.io import matfile
from nablahog.io.matfile import read_mat, read_mat_arrays

NESTED = {
    "record": {
        "filename": "2008_000003.jpg",
        "empty": np.zeros((0, 0)),
        "imgsize": np.array([[500, 375, 3]], np.uint16),
        "matrix": np.arange(12.0).reshape(3, 4),
        "small": np.int8(-2),
        "flag": np.array([[True]]),
        "words": np.array(["a", "bcé", "日本"], dtype=object),
        "objects": np.array([(1.5, "x"), (2.5, "yz")], dtype=[("size", object), ("name", object)]),
    }
}


def _write(path: Path, variables: dict[str, Any], *, compressed: bool = True) -> Path:
    io.savemat(path, variables, do_compression=compressed)
    return path


@pytest.mark.parametrize("compressed", [True, False])
def test_what_scipy_writes(tmp_path: Path, compressed: bool) -> None:
    (record,) = read_mat(_write(tmp_path / "a.mat", NESTED, compressed=compressed))["record"]
    assert record["filename"] == "2008_000003.jpg"
    assert record["empty"].shape == (0, 0)
    assert record["imgsize"].tolist() == [[500, 375, 3]]
    assert record["matrix"].tolist() == np.arange(12.0).reshape(3, 4).tolist()
    assert (record["small"].item(), record["flag"].item()) == (-2, 1)
    assert record["words"] == ["a", "bcé", "日本"]
    assert [(each["size"].item(), each["name"]) for each in record["objects"]] == [(1.5, "x"), (2.5, "yz")]


def test_objects_and_functions_are_passed_over(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.mat", {"a": np.arange(3.0), "b": np.eye(2)}, compressed=False)
    data = bytearray(path.read_bytes())
    assert data[144] == 6  # the class of a: double
    for kind in (3, 5, 16):  # an object, a sparse array, a function
        data[144] = kind
        path.write_bytes(data)
        assert read_mat(path)["a"] is None
        assert read_mat(path)["b"].tolist() == [[1, 0], [0, 1]]
    data[144] = 17  # what has no name either
    path.write_bytes(data)
    assert read_mat(path)[""] is None


def _refusal(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(ValueError, match="expected a MATLAB file of version 5, but ") as error:
        read_mat(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("compressed", [True, False])
def test_damage(tmp_path: Path, compressed: bool) -> None:
    """Whatever byte is wrong: SciPy's own reader ends the process at some of these."""
    path = tmp_path / "a.mat"
    whole = _write(path, NESTED, compressed=compressed).read_bytes()
    for length in range(1, len(whole), 41):
        if length > 128:  # a header alone is a file without variables
            _refusal(path, whole[:length])
    for position in range(126, len(whole), 2):
        for value in (15, 255):  # odd kinds and great lengths, at the places where little-endian words differ
            with suppress(matfile._Damaged):
                matfile._read_variables(whole[:position] + bytes([value]) + whole[position + 1 :])
            with suppress(matfile._Damaged):
                matfile._read_arrays(whole[:position] + bytes([value]) + whole[position + 1 :])


def test_arrays_of_numbers_have_their_types(tmp_path: Path) -> None:
    written = {
        "double": np.array([[1.0, 2.0]]),  # kept as bytes, as its numbers are small integers
        "single": np.linspace(0, 1, 5, dtype=np.float32)[:, None],
        "bytes": np.arange(6, dtype=np.uint8).reshape(2, 3),
        "long": np.array([[-(2**40)]]),
        "flag": np.array([[True, False]]),
    }
    others = {"text": "abc", "record": {"a": 1.0}, "list": np.array(["a"], dtype=object)}
    result = read_mat_arrays(_write(tmp_path / "a.mat", {**written, **others, "complex": np.array([[1 + 2j]])}))
    assert set(result) == {*written, "complex"}
    for name, array in written.items():
        assert result[name].dtype == array.dtype
        np.testing.assert_array_equal(result[name], array)
    assert result["complex"].dtype == np.complex128


def test_what_takes_more_memory_than_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Elements of no bytes, fields of one byte each, and numbers of one byte that become complex."""

    def variable(kind: int, sides: tuple[int, int], rest: bytes) -> bytes:
        flags = struct.pack("<IIII", 6, 8, kind, 0) + struct.pack("<IIii", 5, 8, *sides) + struct.pack("<II", 1, 0)
        return bytes(124) + b"\x00\x01IM" + struct.pack("<II", 14, len(flags + rest)) + flags + rest

    monkeypatch.setattr(matfile, "MAX_ELEMENTS", 100)
    monkeypatch.setattr(matfile, "MAX_ARRAY_BYTES", 1000)
    path = tmp_path / "a.mat"
    assert "more than 100 elements" in _refusal(path, variable(1, (1, 100), struct.pack("<II", 14, 0) * 100))
    fields = struct.pack("<IIii", 5, 4, 1, 0) + struct.pack("<II", 1, 104) + b"a" * 104
    assert "more than 100 fields" in _refusal(path, variable(2, (1, 0), fields))
    path.write_bytes(variable(6 | 0x800, (1, 64), struct.pack("<II", 1, 64) + bytes(64)))
    with pytest.raises(ValueError, match="its arrays take more than 1,000 bytes"):
        read_mat_arrays(path)


def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matfile, "MAX_MAT_BYTES", 2**16)
    path = tmp_path / "a.mat"
    assert "its header" in _refusal(path, b"hello")
    assert "save -v7" in _refusal(path, bytes(512) + b"\x89HDF\r\n\x1a\n")
    header = bytes(124) + b"\x00\x01IM"
    bomb = zlib.compress(bytes(matfile.MAX_MAT_BYTES + 1))
    assert "unpacks to more than" in _refusal(path, header + struct.pack("<II", 15, len(bomb)) + bomb)
    inner = struct.pack("<II", 14, 0)
    for _ in range(matfile.MAX_STRUCT_DEPTH + 2):
        flags = struct.pack("<IIII", 6, 8, 1, 0) + struct.pack("<IIii", 5, 8, 1, 1) + struct.pack("<II", 1, 0)
        inner = struct.pack("<II", 14, len(flags + inner)) + flags + inner
    assert "structures in each other" in _refusal(path, header + inner)
