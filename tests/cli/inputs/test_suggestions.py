"""Arrays of other libraries: those that they returned are read; errors suggest parameters that fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import nablahog
from nablahog.cli.arguments.main import parser
from nablahog.cli.arguments.preset_parameters import PRESETS, as_text
from nablahog.cli.inputs.arrays import ArrayOptions
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.cli.inputs.suggestions import parameters_that_fit, presets_that_fit
from tests.golden import cases

SETTINGS: dict[str, tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]] = {
    "dlib": ("dlib", lambda p: {"cell_size": p["cell_size"]}),
    "maskfeat": (
        "maskfeat",
        lambda p: {"cell_size": p["pool"], "nbins": p["nbins"], "gaussian_window": p["gaussian_window"]},
    ),
    "opencv": (
        "opencv",
        lambda p: {
            "win_size": p["winSize_wh"],
            "block_size": p["blockSize"],
            "block_stride": p["blockStride"],
            "cell_size": p["cellSize"],
            "nbins": p["nbins"],
            "gamma": p["gammaCorrection"],
            "signed": p["signedGradient"],
        },
    ),
    "skimage": (
        "skimage",
        lambda p: {k: v for k, v in p.items() if k != "feature_vector"},
    ),
    "vlfeat": (
        "vlfeat",
        lambda p: {
            "variant": "uoctti" if p["variant"] == "uoctti" else "dalaltriggs",
            "cell_size": p["cellSize"],
            "orientations": p["numOrientations"],
            "bilinear_orientations": p["bilinearOrientations"],
        },
    ),
    "voc_dpm": ("dpm", lambda p: {"cell_size": p["sbin"]}),
}


@pytest.mark.parametrize("peer", SETTINGS)
def test_what_libraries_returned(tmp_path: Path, peer: str) -> None:
    """Stored outputs of the libraries themselves, with parameters as they are typed, are the descriptors here."""
    name, parameters = SETTINGS[peer]
    for case in cases(peer)[::3]:
        values = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters(case.parameters).items()}
        wanted = SpecOptions(name, settings=tuple((key, as_text(value)) for key, value in values.items()))
        np.save(tmp_path / "d.npy", case.output.ravel() if peer == "opencv" else case.output)
        size = case.pixels.shape[:2]
        result = ArrayOptions(None if peer == "opencv" else size).read(str(tmp_path / "d.npy"), wanted)
        assert result.image_size == (values["win_size"][::-1] if peer == "opencv" else size)
        expected = nablahog.hog(case.image.double() / 255, result.spec)[0]
        if result.spec.gamma == "none":  # of roots, rounding decides ties
            torch.testing.assert_close(result.descriptor.double(), expected, rtol=0, atol=1e-6)


# --- what fits instead


@pytest.mark.parametrize(
    ("shape", "name", "given", "size", "own", "others"),
    [
        ((3780,), "skimage", {}, (128, 64), ["--set cells_per_block=2x2"], ["--preset opencv"]),
        (
            (3780,),
            "skimage",
            {"cells_per_block": (2, 2)},
            None,
            ["--image-size 128x64", "--image-size 64x128"],
            ["--preset opencv --set win_size=64x128"],
        ),
        ((1764,), "opencv", {}, None, ["--set win_size=64x64"], []),
        ((1764,), "opencv", {}, (128, 64), ["--image-size 64x64"], []),
        ((1568,), "opencv", {"win_size": (64, 64)}, None, ["--set nbins=8"], []),
        ((7, 7, 72), "opencv", {}, None, ["--set nbins=18", "--set nbins=8 --set block_size=24x24"], []),
        (
            (16, 16, 31),
            "uoctti",
            {},
            (64, 64),
            ["--image-size 128x128", "--cell 4"],
            ["--preset dlib --image-size 144x144"],
        ),
        ((16, 16, 28), "uoctti", {}, None, ["--set orientations=8"], []),
        ((36, 8, 8), "vlfeat", {}, None, ["--set variant=dalaltriggs"], []),
        ((3, 12, 14, 14), "maskfeat", {}, None, ["--set nbins=12"], []),
        ((1, 6, 6, 2, 2, 9), "skimage", {}, None, ["--set cells_per_block=2x2"], []),
        ((16, 16, 32), "uoctti", {}, None, [], ["--preset dpm", "--preset piotr"]),
        ((7936,), "vlfeat", {}, None, ["--image-size 128x128"], []),
    ],
)
def test_what_fits(
    shape: tuple[int, ...],
    name: str,
    given: dict[str, Any],
    size: tuple[int, int] | None,
    own: list[str],
    others: list[str],
) -> None:
    result = parameters_that_fit(shape, name, given, size)
    assert result[: len(own)] == own
    assert len(result) <= 3
    if not own:
        assert not result
    assert [each for each in presets_that_fit(shape, name, size) if each in others] == others


@pytest.mark.parametrize("shape", [(), (0,), (2,), (1, 1), (5, 0, 31), (2, 2, 2, 2), (100_003,)])
@pytest.mark.parametrize("name", PRESETS)
def test_nothing_fits(shape: tuple[int, ...], name: str) -> None:
    assert parameters_that_fit(shape, name, {}, None) == []
    assert presets_that_fit(shape, name, None) == []


@pytest.mark.parametrize(
    ("shape", "name", "size"),
    [((3780,), "skimage", (128, 64)), ((16, 16, 31), "uoctti", (64, 64)), ((1764,), "opencv", None)],
)
def test_what_is_suggested_works(shape: tuple[int, ...], name: str, size: tuple[int, int] | None) -> None:
    """Typed as it stands, beside what was typed."""
    for options in [*parameters_that_fit(shape, name, {}, size), *presets_that_fit(shape, name, size)]:
        typed = ["hog.npy", "-o", "out", "--preset", name]
        if size is not None:
            typed += ["--image-size", as_text(size)]
        arguments = parser().parse_args(["glyph", *typed, *options.split()])
        _, how = ArrayOptions.of(arguments).fitting(shape, SpecOptions.of(arguments))
        assert how.shape == shape


# --- what is said


def _refusal(shape: tuple[int, ...], wanted: SpecOptions, raw: ArrayOptions) -> str:
    with pytest.raises(ValueError, match=r"expected|got|contradict|too few") as error:
        raw.fitting(shape, wanted)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("shape", "wanted", "raw", "message"),
    [
        (
            (3780,),
            SpecOptions("skimage"),
            ArrayOptions((128, 64)),
            "the skimage descriptor of an image of 128x64 pixels (height x width) has the shape (6804,) or "
            "(14, 6, 3, 3, 9) or (14, 6, 81), got (3780,); this fits --set cells_per_block=2x2, or --set "
            "orientations=5, or --set orientations=18 --cell 6 --set cells_per_block=1x1, or --preset opencv",
        ),
        (
            (1764,),
            SpecOptions("opencv"),
            ArrayOptions(),
            "the opencv descriptor of an image of 128x64 pixels (height x width) has the shape (3780,) or (15, 7, 36), "
            "got (1764,); this fits --set win_size=64x64",
        ),
        (
            (7936,),
            SpecOptions("vlfeat"),
            ArrayOptions(),
            "7936 numbers in one row do not say how large their image was: expected --image-size HxW; this fits "
            "--image-size 128x128",
        ),
        (
            (8, 8, 30),
            SpecOptions("vlfeat"),
            ArrayOptions(),
            "the vlfeat descriptor has the shape (31, rows, cols) or (rows, cols, 31), got (8, 8, 30); no parameters",
        ),
        (
            (8, 8, 9),
            SpecOptions("skimage"),
            ArrayOptions(),
            "the skimage descriptor has the shape (rows, cols, 3, 3, 9) or (rows, cols, 81), got (8, 8, 9); this fits "
            "--set cells_per_block=1x1",
        ),
        (
            (3, 9, 8),
            SpecOptions("maskfeat"),
            ArrayOptions(),
            "the maskfeat descriptor has the shape (3, 9, rows, cols) or (27, rows",
        ),
        ((5, 3780), SpecOptions("opencv"), ArrayOptions(), "expected one descriptor in a file, got 5 of them"),
        ((2, 8, 8, 31), SpecOptions("uoctti"), ArrayOptions(), "expected one descriptor in a file, got 2 of them"),
        (
            (3780,),
            SpecOptions("skimage"),
            ArrayOptions((9, 9)),
            "an image of 9x9 pixels (height x width) has 1x1 cells, too few",
        ),
        (
            (3780,),
            SpecOptions("opencv", settings=(("win_size", "64x128"),)),
            ArrayOptions((64, 128)),
            "--image-size 64x128 (height x width) and --set win_size=64x128 (width x height) contradict each other",
        ),
        (
            (3780,),
            SpecOptions(),
            ArrayOptions((128, 64)),
            "an array does not say of which library it is: expected --preset NAME; this fits --preset opencv",
        ),
        (
            (),
            SpecOptions("dpm"),
            ArrayOptions(),
            "the dpm descriptor has the shape (rows, cols, 32), got (); no parameters were found",
        ),
    ],
)
def test_what_is_said(shape: tuple[int, ...], wanted: SpecOptions, raw: ArrayOptions, message: str) -> None:
    assert _refusal(shape, wanted, raw).startswith(message)


def test_a_window_may_be_said_twice() -> None:
    wanted = SpecOptions("opencv", settings=(("win_size", "64x128"),))
    assert ArrayOptions((128, 64)).fitting((3780,), wanted)[1].image_size == (128, 64)
