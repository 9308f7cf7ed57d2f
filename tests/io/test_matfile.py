"""MATLAB files: what SciPy writes is read, what is damaged is refused in a sentence; models of voc-release5."""

from __future__ import annotations

import struct
import zlib
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import io
from scipy.io import savemat
from scipy.ndimage import zoom

from nablahog.io import dpm_file, matfile
from nablahog.io.dpm_file import is_dpm_file, load_dpm
from nablahog.io.matfile import read_mat, read_mat_arrays
from tests.io.dpm_models import PART, ROOT, cells, structs, weights, written

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


@pytest.mark.parametrize("length", [2, 4])
def test_a_text_of_another_length(tmp_path: Path, length: int) -> None:
    path = _write(tmp_path / "a.mat", {"a": "abc"}, compressed=False)
    data = bytearray(path.read_bytes())
    assert data[164] == 3  # the columns of a
    data[164] = length
    assert f"expected text of length {length}, got 3" in _refusal(path, data)


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


HEADER = bytes(124) + b"\x00\x01IM"


def _variable(kind: int, sides: tuple[int, int], rest: bytes) -> bytes:
    flags = struct.pack("<IIII", 6, 8, kind, 0) + struct.pack("<IIii", 5, 8, *sides) + struct.pack("<II", 1, 0)
    return struct.pack("<II", 14, len(flags + rest)) + flags + rest


def test_what_takes_more_memory_than_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Elements of no bytes, fields of one byte each, and numbers of one byte that become complex."""

    monkeypatch.setattr(matfile, "MAX_ELEMENTS", 100)
    monkeypatch.setattr(matfile, "MAX_ARRAY_BYTES", 1000)
    path = tmp_path / "a.mat"
    many, too_many = (HEADER + _variable(1, (1, n), struct.pack("<II", 14, 0) * n) for n in (96, 97))
    path.write_bytes(many)  # with itself, its flags, sides and name
    assert len(read_mat(path)[""]) == 96
    assert "more than 100 elements" in _refusal(path, too_many)
    fields = struct.pack("<IIii", 5, 4, 1, 0) + struct.pack("<II", 1, 104) + b"a" * 104
    assert "more than 100 fields" in _refusal(path, HEADER + _variable(2, (1, 0), fields))
    path.write_bytes(HEADER + _variable(6 | 0x800, (1, 64), struct.pack("<II", 1, 64) + bytes(64)))
    with pytest.raises(ValueError, match="its arrays take more than 1,000 bytes"):
        read_mat_arrays(path)
    monkeypatch.setattr(matfile, "MAX_ARRAY_BYTES", 64 * 16)
    assert read_mat_arrays(path)[""].shape == (1, 64)


def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matfile, "MAX_MAT_BYTES", 2**16)
    path = tmp_path / "a.mat"
    assert "its header" in _refusal(path, b"hello")
    assert "its header" in _refusal(path, bytes(2**16))
    assert "more than 65,536 bytes" in _refusal(path, bytes(2**16 + 1))
    assert "save -v7" in _refusal(path, bytes(512) + b"\x89HDF\r\n\x1a\n")
    bomb = zlib.compress(bytes(matfile.MAX_MAT_BYTES + 1))
    assert "unpacks to more than" in _refusal(path, HEADER + struct.pack("<II", 15, len(bomb)) + bomb)
    whole = zlib.compress(_variable(6, (1, 1), struct.pack("<IId", 9, 8, 0.5)))
    path.write_bytes(HEADER + struct.pack("<II", 15, len(whole)) + whole)
    assert read_mat(path)[""] == 0.5
    without_sum = whole[:-4]
    assert "it ends too early" in _refusal(path, HEADER + struct.pack("<II", 15, len(without_sum)) + without_sum)
    inner = struct.pack("<II", 14, 0)
    for _ in range(matfile.MAX_STRUCT_DEPTH):
        inner = _variable(1, (1, 1), inner)
    path.write_bytes(HEADER + inner)
    assert [*read_mat(path)] == [""]
    assert "structures in each other" in _refusal(path, HEADER + _variable(1, (1, 1), inner))
    of_five_bytes = struct.pack("<HHI", 2, 5, 0) + bytes(8)  # where there is room for four
    assert "it ends too early" in _refusal(path, HEADER + _variable(6, (1, 5), of_five_bytes))


def test_what_is_no_array(tmp_path: Path) -> None:
    path, sides = tmp_path / "a.mat", struct.pack("<IIii", 5, 8, 1, 1)
    whole = HEADER + _variable(6, (1, 1), struct.pack("<IId", 9, 8, 0.5))
    for other, reason in (
        (struct.pack("<IIii", 5, 4, 1, 0), "an array has no shape"),  # one side
        (struct.pack("<IIii", 5, 8, 1, -1), "an array has no shape"),
        (struct.pack("<IId", 9, 8, np.nan), "expected integers"),
    ):
        assert reason in _refusal(path, whole.replace(sides, other))
    path.write_bytes(whole + struct.pack("<II", 14, 0))  # an array of no bytes and no name
    assert read_mat(path)[""].shape == (0, 0)
    assert "it ends too early" in _refusal(path, path.read_bytes()[:-1])


def test_root_and_parts(tmp_path: Path) -> None:
    path = written(tmp_path / "toy.mat")
    result = load_dpm(path)
    assert is_dpm_file(path)
    assert (result.class_name, result.cell_size) == ("toy", 8)
    assert [each.name for each in result.filters] == ["component 1, root", "component 1, parts"]
    root, parts = (each.weights for each in result.filters)
    assert root.dtype == torch.float32
    np.testing.assert_allclose(root, weights(ROOT, 0), atol=1e-6)
    together, covered = np.zeros((6, 8, 32)), np.zeros((6, 8), bool)
    for rows, cols, number in ((slice(2, 4), slice(1, 3), 1), (slice(3, 5), slice(2, 4), 2)):
        together[rows, cols] += weights(PART, number)
        covered[rows, cols] = True
    together[3, 2] /= 2  # where they overlap
    np.testing.assert_allclose(parts[covered], together[covered], atol=1e-6)
    background = zoom(weights(ROOT, 0), (2, 2, 1), order=1, mode="nearest", grid_mode=True)
    scale = np.linalg.norm(together) / np.linalg.norm(background[covered])
    np.testing.assert_allclose(parts[~covered], scale * background[~covered], atol=1e-5)


def test_what_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "text.mat").write_text("hello")
    savemat(tmp_path / "other.mat", {"w": np.ones(3)})
    with pytest.raises(ValueError, match=r"other.mat: expected a model of voc-release5"):
        load_dpm(tmp_path / "other.mat")
    assert not is_dpm_file(tmp_path / "other.mat")
    assert not is_dpm_file(tmp_path / "text.mat")
    assert not is_dpm_file(tmp_path / "none.mat")


def _of(symbols: list[int], *places: tuple[int, ...]) -> dict[str, Any]:
    """The rules of a model of one component, of symbols at places."""
    anchors = cells([np.array(place, float) for place in places])
    return {"rules": cells([structs([{"type": "S", "rhs": np.array(symbols), "anchor": anchors}])])}


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no filters": ({"filters": None}, "expected a model of voc-release5, but it has no 'filters'"),
    "31 channels": (
        {"blocks": structs([{"w": np.ones(31), "shape": np.array([1, 1, 31])} for _ in range(3)])},
        r"a filter has the shape \(1, 1, 31\), not \(rows, cols, 32\)",
    ),
    "NaN": (
        {"blocks": structs([{"w": np.full(32, np.nan), "shape": np.array([1, 1, 32])} for _ in range(3)])},
        "a filter holds NaN or Inf",
    ),
    "parts outside": (
        {"blocks": structs([{"w": np.ones(32), "shape": np.array([1, 1, 32])} for _ in range(3)])},
        "a part of 1x1 cells at 2, 1 is outside its root",
    ),
    "a start that is not there": ({"start": 99}, "expected a model of voc-release5"),
    "fewer places than filters": (_of([3, 5], (0, 0, 0)), "not one place for each of its filters"),
    "a place of two numbers": (_of([3], (0, 0)), "not one place for each of its filters"),
    "no root": (_of([3], (0, 0, 1)), "a component has 0 roots"),
    "two roots": (_of([3, 5], (0, 0, 0), (0, 0, 0)), "a component has 2 roots"),
    "mirror images alone": (_of([9], (0, 0, 0)), "it has no component"),
    "a start that is its own filter": (_of([1], (0, 0, 0)), "its grammar does not end"),
    "a class of numbers": ({"class": 3}, "its class is not text"),
    "a cell of infinite size": ({"sbin": np.inf}, "numbers that are not integers within ±1,000,000"),
}


def test_a_filter_that_is_used_too_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dpm_file, "MAX_WEIGHTS", 4352)  # of both components, 5 · 3 · 4 · 32 of the root
    load_dpm(written(tmp_path / "toy.mat"))
    monkeypatch.setattr(dpm_file, "MAX_WEIGHTS", 4351)
    with pytest.raises(ValueError, match="its components have more than 4,351 weights"):
        load_dpm(tmp_path / "toy.mat")


def test_the_longest_filter(tmp_path: Path) -> None:
    for rows, refused in ((1000, False), (1001, True)):
        blocks = structs([{"w": np.ones(rows * 32), "shape": np.array([rows, 1, 32])}] * 3)
        path = written(tmp_path / "long.mat", blocks=blocks, **_of([3], (0, 0, 0)))
        with pytest.raises(ValueError, match="a filter has the shape") if refused else nullcontext():
            assert load_dpm(path).filters[0].weights.shape == (rows, 1, 32)


@pytest.mark.parametrize("name", WRONG)
def test_wrong_models(tmp_path: Path, name: str) -> None:
    changes, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        load_dpm(written(tmp_path / "wrong.mat", **changes))
