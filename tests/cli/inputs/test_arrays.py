"""Arrays of other libraries as files: which are read, and how the others are refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import io

import nablahog
from nablahog import presets
from nablahog.cli.inputs.arrays import ArrayOptions
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.cli.main import main
from nablahog.io.arrays import is_raw, read_array
from nablahog.io.images import read_image

from ..common import CHELSEA

SPEC = presets.vlfeat()
SIZE = (48, 64)


@pytest.fixture(scope="module")
def array() -> NDArray[np.float32]:
    """What VLFeat returns, (31, 6, 8)."""
    image = torch.from_numpy(CHELSEA[:48, :64].copy()).permute(2, 0, 1)[None]
    return nablahog.hog(image, SPEC, layout="native")[0].numpy()


def _npz(**arrays: Any) -> Callable[[Path], None]:
    return lambda path: np.savez(path, **arrays)


def _mat(**arrays: Any) -> Callable[[Path], None]:
    return lambda path: io.savemat(path, arrays)


@pytest.mark.parametrize("kind", ["float16", "float32", "float64", ">f4", ">f8"])
@pytest.mark.parametrize("ending", ["npy", "npz", "mat", "npy-batch", "npy-ours", "npy-fortran", "mat-compressed"])
def test_files(tmp_path: Path, array: NDArray[np.float32], kind: str, ending: str) -> None:
    values, path = array.astype(kind), tmp_path / "d.dat"
    if ending.startswith("mat"):
        native = values.astype(values.dtype.newbyteorder("=") if kind != "float16" else np.float32)
        others = {"sbin": 8.0, "name": "cat", "record": {"x": np.zeros(3)}}
        io.savemat(path, {"hog": native, **others}, do_compression=ending.endswith("compressed"), appendmat=False)
    else:
        layouts: dict[str, NDArray[Any]] = {
            "npy-batch": values[None],
            "npy-ours": values.transpose(1, 2, 0),
            "npy-fortran": np.asfortranarray(values),
        }
        with open(path, "wb") as file:
            if ending == "npz":
                np.savez(file, hog=values, sbin=8.0, name="cat", objects=np.array([{}], dtype=object))
            else:
                np.save(file, layouts.get(ending, values))
    assert is_raw(path)
    result = ArrayOptions().read(str(path), SpecOptions("vlfeat"))
    assert (result.spec, result.image_size) == (SPEC, SIZE)
    assert result.descriptor.dtype == (torch.float64 if values.dtype.itemsize == 8 else torch.float32)
    expected = torch.from_numpy(values.astype(np.float64)).permute(1, 2, 0)
    assert torch.equal(result.descriptor.double(), expected)


def test_one_of_several(tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None]) -> None:
    several = {"hog": array, "other": array[:, :5], "size": np.array([48, 64])}
    np.savez(tmp_path / "d.npz", **several, text="cat")
    io.savemat(tmp_path / "d.mat", several)
    for ending, size in (("npz", "(2,)"), ("mat", "(1, 2)")):
        path = str(tmp_path / f"d.{ending}")
        command = ["glyph", path, "--preset", "vlfeat", "-o", str(tmp_path / f"{ending}.png")]
        listed = f"the file holds hog (31, 6, 8), other (31, 5, 8), size {size}"
        refused(*command, message=f"{path}: expected one array or --key NAME, {listed}")
        refused(*command, "--key", "text", message=f"{path}: there is no array 'text' of numbers, {listed}")
        refused(*command, "--key", "size", message=f"{path}: expected a descriptor of float16, float32 or float64, got")
        assert main([*command, "--key", "other"]) == 0
        assert read_image(tmp_path / f"{ending}.png").shape == (1, 5 * 16, 8 * 16)


def _with(value: float) -> Callable[[Path], None]:
    values = np.zeros((31, 6, 8), np.float32)
    values[3, 2, 1] = value
    return lambda path: np.save(path, values)


class _Bomb:
    """Unpickling this makes a folder."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, ("gone off",)


def _header(path: Path, header: str) -> None:
    text = header.encode().ljust(117) + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(64))


BAD: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "missing": ("d.npy", lambda path: None, "no such file"),
    "missing .mat": ("d.mat", lambda path: None, "no such file"),
    "empty": ("d.npy", lambda path: path.touch(), "expected an array (.npy), but it cannot be read"),
    "text": ("d.npy", lambda path: path.write_text("hello"), "expected an array (.npy), but it cannot be read"),
    "a folder": ("d.npy", lambda path: path.mkdir(), "expected a file, or a folder of files"),
    "truncated": (
        "d.npy",
        lambda path: (_with(0)(path), path.write_bytes(path.read_bytes()[:-9])),
        "expected an array (.npy), but it cannot be read",
    ),
    "a bomb": (
        "d.npy",
        lambda path: _header(path, "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999,), }"),
        "expected an array (.npy), but it cannot be read",
    ),
    "no header": ("d.npy", lambda path: _header(path, "__import__('os')"), "expected an array (.npy), but"),
    "pickled": (
        "d.npy",
        lambda path: np.save(path, np.array([_Bomb()], dtype=object), allow_pickle=True),
        "the file holds pickled objects, which are never loaded",
    ),
    "pickled in .npz": ("d.npz", _npz(a=np.array([_Bomb()], dtype=object)), "the file holds no array of numbers"),
    "an empty archive": ("d.npz", _npz(), "expected one array or --key NAME, the file holds no array of numbers"),
    "texts": ("d.npz", _npz(a=np.array(["x"])), "the file holds no array of numbers"),
    "uint8": ("d.npy", lambda path: np.save(path, np.zeros((31, 6, 8), np.uint8)), "float32 or float64, got uint8"),
    "int64": ("d.npz", _npz(a=np.zeros((31, 6, 8), np.int64)), "float16, float32 or float64, got int64"),
    "bool": ("d.npy", lambda path: np.save(path, np.zeros((31, 6, 8), bool)), "got bool"),
    "complex": ("d.npy", lambda path: np.save(path, np.zeros((31, 6, 8), complex)), "got complex128"),
    "long double": (
        "d.npy",
        lambda path: np.save(path, np.zeros((31, 6, 8), np.longdouble)),
        f"got {np.dtype(np.longdouble)}",
    ),
    "uint8 of MATLAB": ("d.mat", _mat(a=np.zeros((31, 6, 8), np.uint8)), "got uint8"),
    "logical of MATLAB": ("d.mat", _mat(a=np.zeros((31, 6, 8), bool)), "got bool"),
    "complex of MATLAB": ("d.mat", _mat(a=np.ones((31, 6, 8), complex) * 1j), "got complex128"),
    "no .mat": ("d.mat", lambda path: path.write_text("hello"), "expected a MATLAB file of version 5, but its header"),
    "version 7.3": (
        "d.mat",
        lambda path: path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(99)),
        "it is of version 7.3; save it with `save -v7`",
    ),
    "NaN": ("d.npy", _with(np.nan), "the descriptor must be finite, got NaN or Inf"),
    "Inf": ("d.npy", _with(-np.inf), "the descriptor must be finite, got NaN or Inf"),
    "too large": ("d.npy", lambda path: np.save(path, np.full((31, 6, 8), 1e300)), "must fit float32"),
    "another shape": ("d.npy", lambda path: np.save(path, np.zeros((6, 8, 32))), "or --preset dpm, or --preset piotr"),
    "two": ("d.npy", lambda path: np.save(path, np.zeros((2, 31, 6, 8))), "expected one descriptor in a file, got 2"),
    "a scalar": ("d.npy", lambda path: np.save(path, np.float32(1)), "got (); no parameters were found that fit"),
    "nothing": ("d.npy", lambda path: np.save(path, np.zeros((31, 0, 8))), "got (31, 0, 8); no parameters were found"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_files(tmp_path: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    monkeypatch.chdir(tmp_path)
    name, make, message = BAD[what]
    path = tmp_path / name
    make(path)
    for command in ("glyph", "invert"):
        arguments = [command, str(path), "-o", str(tmp_path / "out"), "--preset", "vlfeat"]
        refused(*arguments, message=f"{path}: ")
        refused(*arguments, message=message)


def test_damaged_files_are_refused_in_a_sentence(tmp_path: Path, array: NDArray[np.float32]) -> None:
    """Whatever byte of a header is wrong."""
    path, refusals = tmp_path / "d", 0
    for save in (lambda file: np.save(file, array), lambda file: io.savemat(file, {"a": array})):
        with open(path, "wb") as file:
            save(file)
        whole = path.read_bytes()
        for place in range(0, 200, 3):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x11]) + whole[place + 1 :])
            refusals += _refused(path)
    assert refusals > 30


def _refused(path: Path) -> bool:
    if not is_raw(path):
        return True
    try:
        read_array(path, None)
    except ValueError as error:
        return str(error).startswith(f"{path}: ")
    return False


@pytest.mark.parametrize(
    ("options", "message", "status"),
    [
        ([], "an array does not say of which library it is: expected --preset NAME; this fits --preset dlib, or", 1),
        (["--preset", "vlfeat", "--key", "a"], "--key goes with .npz and .mat files, a .npy file holds one array", 1),
        (["--preset", "vlfeat", "--image-size", "64"], "expected pixels as HEIGHTxWIDTH, each at least 1, got '64'", 2),
        (["--preset", "vlfeat", "--image-size", "0x64"], "got '0x64'", 2),
        (
            ["--preset", "vlfeat", "--image-size", "64x48"],
            "the vlfeat descriptor of an image of 64x48 pixels (height x width) has the shape (31, 8, 6) or (8, 6, "
            "31), got (31, 6, 8); this fits --image-size 48x64, or --preset",
            1,
        ),
        (["--preset", "vlfeat", "--image-size", "2x2"], "the image must hold at least one cell", 1),
    ],
)
def test_options(
    tmp_path: Path,
    array: NDArray[np.float32],
    refused: Callable[..., None],
    options: list[str],
    message: str,
    status: int,
) -> None:
    np.save(tmp_path / "d.npy", array)
    for command in ("glyph", "invert"):
        out = ["-o", str(tmp_path / "out")]
        refused(command, str(tmp_path / "d.npy"), *out, *options, message=message, status=status)


def test_options_that_nothing_needs(tmp_path: Path, photo: str, descriptor: str, refused: Callable[..., None]) -> None:
    for option, value in (("--image-size", "60x80"), ("--key", "hog")):
        for path in (photo, descriptor):
            message = f"{option} goes with arrays of other libraries, and no input is one (.npy, .npz, .mat)"
            refused("invert", path, "-o", str(tmp_path / "out"), option, value, message=message)


def test_hog_takes_photographs(tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None]) -> None:
    np.save(tmp_path / "d.npy", array)
    refused("hog", str(tmp_path / "d.npy"), "-o", str(tmp_path / "o"), message="expected an image, got a file of no")


def test_the_array_is_not_overwritten(tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None]) -> None:
    path = str(tmp_path / "d.npy")
    np.save(path, array)
    os.rename(path, tmp_path / "d_glyphs.png")  # its first bytes say what it is
    command = ["glyph", str(tmp_path / "d_glyphs.png"), "--preset", "vlfeat", "-o"]
    refused(*command, str(tmp_path / "d_glyphs.png"), message="would overwrite an input")
