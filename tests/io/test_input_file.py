"""Every reader of files takes bytes under a name as it takes the file, and calls them by that name in its errors."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image
from scipy.io import savemat

import nablahog
from nablahog.compat.opencv import HOGDescriptor
from nablahog.io.arrays import is_archive, is_raw, read_array, refuse_pickle
from nablahog.io.camera_file import read_camera_file
from nablahog.io.dpm_file import load_dpm
from nablahog.io.images import longer_side, read_exif_focal, read_image
from nablahog.io.input_file import InputFile
from nablahog.io.lists import read_objects
from nablahog.io.matfile import read_mat
from nablahog.pose.whitening import Background
from nablahog.requests.inversion import GlyphRequest
from nablahog.requests.templates import read_templates

SPEC = nablahog.presets.uoctti()


def _photo(path: Path) -> None:
    exif = Image.Exif()
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 26}
    Image.fromarray(np.arange(96, dtype=np.uint8).reshape(8, 12)).save(path, exif=exif)


def _npy(path: Path) -> None:
    np.save(path, np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)))


def _mat(path: Path) -> None:
    savemat(path, {"x": np.arange(6.0).reshape(2, 3)})


def _npz(path: Path) -> None:
    nablahog.save_descriptor(path, np.zeros((8, 6, 31), np.float32), SPEC, (64, 48))


def _yml(path: Path) -> None:
    HOGDescriptor((32, 64), (16, 16), (8, 8), (8, 8), 9).save(str(path))


@pytest.mark.parametrize(
    ("name", "write", "read"),
    [
        ("a.png", _photo, read_image),
        ("a.jpg", _photo, longer_side),
        ("a.jpg", _photo, read_exif_focal),
        ("a.npy", _npy, lambda file: read_array(file, None)),
        ("a.mat", _mat, lambda file: read_array(file, "x")),
        ("a.mat", _mat, lambda file: read_mat(file)["x"]),
        ("a.mat", _mat, is_raw),
        ("a", _npz, is_archive),
        ("a.npz", _npz, lambda file: nablahog.load_descriptor(file).descriptor),
        ("a.yml", _yml, lambda file: [*map(str, _opencv_parameters(file))]),
    ],
)
def test_bytes_are_read_as_the_file_is(
    tmp_path: Path, name: str, write: Callable[[Path], None], read: Callable[[Any], Any]
) -> None:
    path = tmp_path / name
    write(path)
    expected = read(path)
    assert expected is not None
    np.testing.assert_array_equal(read(InputFile(f"{tmp_path}/nowhere/{name}", path.read_bytes())), expected)


READERS: dict[str, Callable[[Any], Any]] = {
    "a.png": read_image,
    "a.npy": lambda file: read_array(file, None),
    "a.mat": read_mat,
    "dpm.mat": load_dpm,
    "a.npz": nablahog.load_descriptor,
    "background.npz": Background.load,
    "a.csv": read_objects,
    "camera.json": read_camera_file,
    "a.off": nablahog.load_mesh,
    "a.pkl": refuse_pickle,
    "weights": lambda file: read_templates(file, GlyphRequest()),
}


@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_said_in_the_same_words(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with pytest.raises(FileNotFoundError, match=f"^{path}: no such file"):
        READERS[name](path)
    path.mkdir()
    with pytest.raises(ValueError, match=f"^{path}: expected .*, got a folder$"):
        READERS[name](path)
    path.rmdir()
    os.mkfifo(path)
    with pytest.raises(ValueError, match=f"^{path}: expected .*, got a special file$"):
        READERS[name](path)


def _opencv_parameters(file: Any) -> list[Any]:
    hog = HOGDescriptor()
    hog.load(file)
    return [hog.winSize, hog.blockSize, hog.nbins]


@pytest.mark.parametrize("name", sorted(READERS.keys() - {"a.csv"}))  # which takes a path alone
def test_errors_call_bytes_by_their_name(name: str) -> None:
    for content in (b"", b"nothing of use", b"\x93NUMPY", b"PK\3\4"):
        with pytest.raises(ValueError, match=f"^my {name}: ") as caught:
            READERS[name](InputFile(f"my {name}", content))
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="needs Linux")
def test_a_file_that_cannot_be_read_is_of_no_kind() -> None:
    assert not is_raw("/proc/self/mem")


def test_an_array_of_a_damaged_header_takes_no_memory() -> None:
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }"
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    content = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header + bytes(4)
    with pytest.raises(ValueError, match=r"^a\.npy: expected an array"):
        read_array(InputFile("a.npy", content), None)
