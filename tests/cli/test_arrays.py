"""Arrays of other libraries as inputs: which are read, and how the others are refused."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

import nablahog
from nablahog import presets
from nablahog.cli.main import main
from nablahog.io.images import read_image

from .common import CHELSEA

SPEC = presets.vlfeat()


@pytest.fixture(scope="module")
def array() -> NDArray[np.float32]:
    """What VLFeat returns, (31, 6, 8)."""
    image = torch.from_numpy(CHELSEA[:48, :64].copy()).permute(2, 0, 1)[None]
    return nablahog.hog(image, SPEC, layout="native")[0].numpy()


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
    refused(*command, message=f"{path}: expected one array, but the file holds hog (31, 6, 8), other")
    refused(*command, "--key", "text", message="there is no array 'text' of numbers")
    assert main([*command, "--key", "other"]) == 0
    assert read_image(tmp_path / "g.png").shape == (1, 5 * 16, 8 * 16)


def test_a_text_is_no_array(tmp_path: Path, refused: Callable[..., None]) -> None:
    (tmp_path / "d.csv").write_text("0.1,0.2,0.3")
    command = ["glyph", str(tmp_path / "d.csv"), "-o", str(tmp_path / "g.png")]
    refused(*command, message="d.csv: expected an image, got numbers")
    refused(*command, message="; arrays are read from .npy, .npz and .mat files")


class _Bomb:
    """Unpickling this makes a folder."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, ("gone off",)


@pytest.mark.parametrize(("name", "line"), [("svm.joblib", "joblib.load('svm.joblib').coef_"), ("svm", "pickle.load(")])
def test_pickles_are_answered_with_the_line_that_saves_their_weights(
    tmp_path: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, name: str, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(pickle.dumps(_Bomb()))
    for template in ([], ["--template"]):
        refused("invert", str(tmp_path / name), "-o", str(tmp_path / "out"), *template, message=line)
    assert not (tmp_path / "gone off").exists()


def test_weights_of_unknown_origin_are_not_taken_for_a_descriptor(tmp_path: Path, refused: Callable[..., None]) -> None:
    path = str(tmp_path / "coef.npy")
    np.save(path, np.random.default_rng(0).normal(size=(1, 3780)))
    refused("invert", path, "-o", str(tmp_path / "out"), message="weights of a detector: expected --template")


def test_a_matrix(
    tmp_path: Path, array: NDArray[np.float32], refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = str(tmp_path / "d.npy"), str(tmp_path / "out")
    np.save(path, np.stack([array.ravel(), array[:, ::-1].ravel()]))
    asked = ["glyph", path, "--preset", "vlfeat", "--image-size", "48x64"]
    assert main([*asked, "-o", out]) == 0
    assert sorted(os.listdir(out)) == ["d_000000_glyphs.png", "d_000001_glyphs.png"]
    assert main([*asked, "--row", "1", "-o", str(tmp_path / "g.png")]) == 0
    assert (read_image(tmp_path / "g.png") == read_image(Path(out) / "d_000001_glyphs.png")).all()
    refused(*asked, "--row", "2", "-o", out, message="no row 2")


def test_what_decides_is_said(tmp_path: Path, array: NDArray[np.float32], capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "d.npy", array)
    assert main(["glyph", str(tmp_path / "d.npy"), "-o", str(tmp_path / "g.png")]) == 0
    assert "--preset vlfeat, because " in capsys.readouterr().err


def test_a_remark_on_the_numbers_stands_on_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = str(tmp_path / "v.npy"), tmp_path / "out"
    np.save(path, np.full((2, 324), 0.1))
    asked = ["--preset", "opencv", "--image-size", "32x32", "--quality", "fast"]
    assert main(["invert", path, *asked, "-o", str(out)]) == 0
    assert capsys.readouterr().err.count("its numbers are all equal") == 1
    assert (out / "index.html").read_text(encoding="utf-8").count("its numbers are all equal") == 2


@pytest.mark.slow
def test_options(tmp_path: Path, array: NDArray[np.float32], photo: str, refused: Callable[..., None]) -> None:
    path, out = str(tmp_path / "d.npy"), ["-o", str(tmp_path / "out")]
    np.save(path, array)
    for name, other in (
        ("nine", array[:9]),
        ("flat", np.zeros(3780)),
        ("large", np.full((31, 6, 8), 1e300)),
        ("dpm", np.random.default_rng(0).random((6, 8, 32)) - 0.5),
    ):
        np.save(tmp_path / f"{name}.npy", other)
    refused("invert", str(tmp_path / "nine.npy"), *out, message="its numbers do not tell which")
    preset = ["--preset", "vlfeat"]
    refused("invert", path, *out, *preset, "--key", "a", message="a .npy file holds one array")
    refused("invert", str(tmp_path / "large.npy"), *out, *preset, message="large.npy: the descriptor must fit float32")
    refused("invert", str(tmp_path / "flat.npy"), *out, *preset, message="its numbers are all equal")
    refused("invert", str(tmp_path / "dpm.npy"), *out, *preset, message="this fits --preset dpm, or --preset piotr")
    refused("invert", path, *out, *preset, "--image-size", "64x48", message="(31, 8, 6) or (8, 6, 31), got (31, 6, 8)")
    refused("invert", photo, *out, "--key", "hog", message="--key goes with arrays of other libraries")


@pytest.mark.slow
def test_parameters_without_a_preset_are_those_of_the_one_that_is_found(
    tmp_path: Path, refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    """No other preset is spoken of, and what was set stays in what is advised."""
    image = CHELSEA[:48, :64].mean(2) / 255
    np.save(tmp_path / "v.npy", nablahog.compat.skimage.hog(image, pixels_per_cell=(4, 4)))
    command = ["glyph", str(tmp_path / "v.npy"), "-o", str(tmp_path / "g.png"), "--set"]
    assert main([*command, "pixels_per_cell=4x4"]) == 0
    assert "--preset skimage --set pixels_per_cell=4x4 --image-size 48x64, because" in capsys.readouterr().err
    refused(*command, "cell_size=4", message="--set cell_size=4")
    refused(*command, "orientations=11", message="no preset with orientations=11 makes descriptors of the")
    refused(*command, "pixels_per_cel=4", message="no preset has a parameter 'pixels_per_cel'; did you mean", status=2)
    Image.fromarray(CHELSEA).save(tmp_path / "cat.png")
    command[1] = str(tmp_path / "cat.png")
    refused(
        *command,
        "nbins=9",
        message="has no parameter 'nbins'; maskfeat, opencv have it: expected one of these as --preset",
    )
    nablahog.save_descriptor(tmp_path / "d.npz", nablahog.hog(image, "dalal_triggs"), presets.dalal_triggs(), (48, 64))
    command[1] = str(tmp_path / "d.npz")
    assert main([*command, "cell_size=8"]) == 0
    refused(*command, "cell_size=4", message="its cell_size is (8, 8), not (4, 4)")
