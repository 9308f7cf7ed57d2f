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
from skimage import data, feature

import nablahog
from nablahog import presets
from nablahog.cli.arguments.presets import SpecOptions
from nablahog.cli.inputs.arrays import ArrayOptions, likeliest, presets_that_fit
from nablahog.cli.main import main
from nablahog.io.images import read_image

from ..common import CHELSEA

SPEC = presets.vlfeat()
FITS_1764 = ("opencv --set win_size=64x64", "skimage --set cells_per_block=2x2 --image-size 64x64")


@pytest.fixture(scope="module")
def array() -> NDArray[np.float32]:
    """What VLFeat returns, (31, 6, 8)."""
    image = torch.from_numpy(CHELSEA[:48, :64].copy()).permute(2, 0, 1)[None]
    return nablahog.hog(image, SPEC, layout="native")[0].numpy()


@pytest.mark.parametrize(
    ("ending", "kind"),
    [("npy", ">f4"), ("npz", "float64"), ("mat", "float64"), ("npy-batch", "float16"), ("npy-ours", "float64")],
)
def test_files(tmp_path: Path, array: NDArray[np.float32], kind: str, ending: str) -> None:
    values, path = array.astype(kind), tmp_path / "d.dat"
    if ending == "mat":
        io.savemat(path, {"hog": values, "sbin": 8.0, "name": "cat"}, appendmat=False)
    else:
        with open(path, "wb") as file:
            if ending == "npz":
                np.savez(file, hog=values, sbin=8.0, name="cat", objects=np.array([{}], dtype=object))
            else:
                np.save(file, {"npy-batch": values[None], "npy-ours": values.transpose(1, 2, 0)}.get(ending, values))
    result = ArrayOptions().read(str(path), SpecOptions("vlfeat"))
    assert (result.spec, result.image_size) == (SPEC, (48, 64))
    assert torch.equal(result.descriptor.double(), torch.from_numpy(values.astype(np.float64)).permute(1, 2, 0))


def test_a_folder(tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None]) -> None:
    np.save(tmp_path / "a.npy", array)
    out = ["-o", str(tmp_path / "out")]
    assert main(["glyph", str(tmp_path), "--preset", "vlfeat", *out]) == 0
    assert (tmp_path / "out" / "a_glyphs.png").exists()
    refused("glyph", str(tmp_path), *out, message="expected a file, or a folder of files")


def test_one_of_several(tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None]) -> None:
    path = str(tmp_path / "d.npz")
    np.savez(path, hog=array, other=array[:, :5], size=np.array([48, 64]), text="cat")
    command = ["glyph", path, "--preset", "vlfeat", "-o", str(tmp_path / "g.png")]
    refused(*command, message=f"{path}: expected one array or --key NAME, but the file holds hog (31, 6, 8), other")
    refused(*command, "--key", "text", message="there is no array 'text' of numbers")
    assert main([*command, "--key", "other"]) == 0
    assert read_image(tmp_path / "g.png").shape == (1, 5 * 16, 8 * 16)


class _Bomb:
    """Unpickling this makes a folder."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, ("gone off",)


BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "pickled": (
        lambda path: np.save(path, np.array([_Bomb()], dtype=object), allow_pickle=True),
        "pickled objects, which are never loaded",
    ),
    "too large": (lambda path: np.save(path, np.full((31, 6, 8), 1e300)), "must fit float32"),
    "another shape": (lambda path: np.save(path, np.zeros((6, 8, 32))), "this fits --preset dpm, or --preset piotr"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_files(tmp_path: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    monkeypatch.chdir(tmp_path)
    make, message = BAD[what]
    path = tmp_path / "d.npy"
    make(path)
    command = ["glyph", str(path), "-o", str(tmp_path / "out"), "--preset", "vlfeat"]
    refused(*command, message=f"{path}: ")
    refused(*command, message=message)


def test_options(tmp_path: Path, array: NDArray[np.float32], photo: str, refused: Callable[..., None]) -> None:
    path, out = str(tmp_path / "d.npy"), ["-o", str(tmp_path / "out")]
    np.save(path, array)
    refused("invert", path, *out, message="it is --preset vlfeat (0.0")
    preset = ["--preset", "vlfeat"]
    refused("invert", path, *out, *preset, "--key", "a", message="--key goes with .npz and .mat files")
    refused("invert", path, *out, *preset, "--image-size", "0x64", message="got '0x64'", status=2)
    refused("invert", path, *out, *preset, "--image-size", "64x48", message="(31, 8, 6) or (8, 6, 31), got (31, 6, 8)")
    refused("invert", photo, *out, "--key", "hog", message="--key goes with arrays of other libraries")
    refused("hog", path, *out, message="expected an image, got a file of no")


@pytest.mark.parametrize(
    ("shape", "size", "options"),
    [
        ((3780,), (128, 64), {"--preset opencv", "--preset skimage --set cells_per_block=2x2"}),
        ((1764,), None, {f"--preset {name}" for name in FITS_1764}),
        ((6804,), (128, 64), {"--preset skimage"}),
        ((16, 16, 32), None, {"--preset dpm", "--preset piotr"}),
        ((16, 16, 31), (144, 144), {"--preset dlib"}),
        ((31, 8, 8), None, {"--preset vlfeat", "--preset dlib"}),
    ],
)
def test_what_fits(shape: tuple[int, ...], size: tuple[int, int] | None, options: set[str]) -> None:
    fitting = presets_that_fit(shape, size)
    assert {each.options for each in fitting} == options
    for each in fitting:  # works as it stands
        _, how = ArrayOptions(each.image_size or size).fitting(shape, each.dialect)
        assert how.shape == shape
    for nothing in ((), (0,), (5, 0, 31), (100_003,)):
        assert presets_that_fit(nothing, None) == []


def test_which_of_those_that_fit_it_is(tmp_path: Path) -> None:
    """scikit-image's blocks share cells, dlib's cells its weights; OpenCV's votes cannot be told from others."""
    image = data.camera()[100:228, 200:328]
    vector = feature.hog(image, cells_per_block=(2, 2))
    (nearest, first), (second, _), *_ = likeliest(vector, None)
    assert first.options == "--preset skimage --set cells_per_block=2x2 --image-size 128x128"
    assert 2 * nearest < second
    (nearest, first), (second, _) = likeliest(nablahog.hog(image, "dlib").transpose(2, 0, 1), None)
    assert first.options == "--preset dlib"
    assert 2 * nearest < second
    opencv = presets.opencv(win_size=(128, 128))
    (nearest, _), (second, _), *_ = likeliest(nablahog.hog(image, opencv, layout="native"), None)
    assert 2 * nearest > second


@pytest.mark.parametrize(
    ("shape", "spec", "arrays", "message"),
    [
        ((7936,), SpecOptions("vlfeat"), ArrayOptions(), "do not say how large their image was"),
        ((5, 3780), SpecOptions("opencv"), ArrayOptions(), "expected one descriptor in a file, got 5"),
        ((3780,), SpecOptions("opencv", (("win_size", "64x128"),)), ArrayOptions((64, 64)), "contradict each other"),
    ],
)
def test_what_is_refused(shape: tuple[int, ...], spec: SpecOptions, arrays: ArrayOptions, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        arrays.fitting(shape, spec)
