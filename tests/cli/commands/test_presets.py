"""Every preset by the command: a photograph's descriptor, its picture, and an image from it alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import nablahog
from nablahog import HOGSpec, presets
from nablahog.cli.arguments.preset_parameters import PRESETS
from nablahog.cli.inputs.spec import make_spec
from nablahog.cli.main import main
from nablahog.invert import Search
from nablahog.invert.learned import PriorChoice, default_prior_file
from nablahog.io.descriptor_file import load_descriptor, save_descriptor
from nablahog.io.images import Picture, read_image, to_pil
from nablahog.pose.whitening import Background
from nablahog.viz.pictures import glyphs

from ..common import CHELSEA, names

SIZE = (56, 64)
FEW = ["--max-evaluations", "40"]
OPTIONS: dict[str, tuple[list[str], HOGSpec]] = {
    **{name: (["--preset", name], make_spec(name, {})) for name in PRESETS},
    "skimage-set": (
        ["--preset", "skimage", "--set", "orientations=8", "--set", "block_norm=L1", "--cell", "8x6"],
        presets.skimage(8, (8, 6), block_norm="L1"),
    ),
    "opencv-set": (
        ["--preset", "opencv", "--set", "win_size=64x56", "--set", "block_stride=16x8", "--set", "gamma=false"],
        presets.opencv((64, 56), block_stride=(16, 8), gamma=False),
    ),
    "vlfeat-set": (
        ["--preset", "vlfeat", "--set", "variant=dalaltriggs", "--vote", "linear"],
        presets.vlfeat("dalaltriggs", bilinear_orientations=True),
    ),
}


@pytest.fixture
def square(tmp_path: Path) -> str:
    """A colour photograph of 56x64 pixels."""
    (tmp_path / "in").mkdir(exist_ok=True)
    Image.fromarray(CHELSEA[:56, 8:72]).save(tmp_path / "in" / "photo.png")
    return str(tmp_path / "in" / "photo.png")


@pytest.mark.parametrize("name", OPTIONS)
def test_there_and_back(tmp_path: Path, square: str, name: str) -> None:
    options, spec = OPTIONS[name]
    stored, array, out = tmp_path / "d.npz", tmp_path / "d.npy", tmp_path / "out"
    assert main(["hog", square, "-o", str(stored), *options]) == 0
    loaded = load_descriptor(stored)
    image = read_image(square)[None]
    assert (loaded.spec, loaded.image_size) == (spec, SIZE)
    assert torch.equal(loaded.descriptor, nablahog.hog(image, spec)[0])

    # what the library itself saves, of the same image, is drawn and inverted alike
    np.save(array, nablahog.hog(image, spec, layout="native")[0].numpy())
    drawn = [tmp_path / "g.png", tmp_path / "h.png"]
    assert main(["glyph", square, "-o", str(drawn[0]), *options]) == 0
    assert main(["glyph", str(array), "-o", str(drawn[1]), *options, "--image-size", "56x64"]) == 0
    assert _levels(drawn[0]) == _levels(drawn[1]) == _levels(glyphs(loaded.descriptor, spec))
    assert main(["invert", str(array), "-o", str(out), *options, "--image-size", "56x64", *FEW]) == 0
    assert names(out) == ["d_glyphs.png", "d_preimage.png", "d_thumbnails.png", "index.html", "results.json"]
    prior: PriorChoice = "default" if default_prior_file(spec) else None
    result = nablahog.reconstruct(loaded.descriptor[None], spec, SIZE, prior=prior, search=Search(max_evaluations=40))
    assert _levels(out / "d_preimage.png") == _levels(result.image[0])
    (figures,) = json.loads((out / "results.json").read_text())
    assert (figures["descriptor"], figures["image_size"], figures["cc"]) == (spec.name, list(SIZE), None)
    assert figures["distance"] == pytest.approx(float(result.distance[0]))


def _levels(picture: Path | Picture) -> bytes:
    return (Image.open(picture) if isinstance(picture, Path) else to_pil(picture)).tobytes()


def test_photographs_descriptor_files_and_arrays_together(tmp_path: Path, square: str) -> None:
    spec, out = presets.dlib(), tmp_path / "out"
    image = read_image(square)[None]
    np.save(tmp_path / "array.npy", nablahog.hog(image, spec, layout="native").numpy())
    save_descriptor(tmp_path / "stored.npz", nablahog.hog(image, spec)[0], spec, SIZE)
    inputs = [square, str(tmp_path / "array.npy"), str(tmp_path / "stored.npz")]
    assert main(["invert", *inputs, "-o", str(out), "--preset", "dlib", "--max-evaluations", "5"]) == 0
    results = json.loads((out / "results.json").read_text())
    assert [each["input"] for each in results] == inputs
    assert len({round(each["distance"], 3) for each in results}) == 1
    assert [each["cc"] is None for each in results] == [False, True, True]


def test_the_old_name_of_the_option(tmp_path: Path, square: str) -> None:
    for option in ("--preset", "--descriptor"):
        assert main(["hog", square, "-o", str(tmp_path / option), option, "paper"]) == 0
    assert (tmp_path / "--preset").read_bytes() == (tmp_path / "--descriptor").read_bytes()


def test_aubrys_cells_are_of_8_unless_asked_for(tmp_path: Path, square: str) -> None:
    assert main(["hog", square, "-o", str(tmp_path / "d"), "--preset", "aubry"]) == 0
    assert load_descriptor(tmp_path / "d").spec == presets.aubry(8)
    assert main(["hog", square, "-o", str(tmp_path / "d"), "--preset", "aubry", "--set", "cell_size=5"]) == 0
    assert load_descriptor(tmp_path / "d").spec == presets.aubry()


@pytest.mark.parametrize(
    ("options", "message", "status"),
    [
        (["--preset", "sift"], "argument --preset/--descriptor: invalid choice: 'sift'", 2),
        (["--set", "orientations"], "expected KEY=VALUE, a parameter of the preset, got 'orientations'", 2),
        (["--set", "=8"], "expected KEY=VALUE", 2),
        (["--set", "nbins=8"], "--set: uoctti has no parameter 'nbins', but cell_size, vote, orientations, colour", 1),
        (["--preset", "skimage", "--set", "block_norm=L3"], "block_norm: expected one of L1, L1-sqrt, L2, L2-Hys", 1),
        (["--preset", "opencv", "--cell", "6"], "got a window of 64, a block of 16, a stride of 8 and a cell of 6", 1),
        (["--preset", "maskfeat", "--cell", "8x4"], "cells of maskfeat are square: expected --cell N, got 8x4", 1),
        (["--preset", "skimage", "--vote", "linear"], "the skimage descriptor has hard votes: --vote linear goes", 1),
        (["--preset", "dlib", "--cell", "32"], "an image of 56x64 pixels (height x width) has 2x2 cells, too few", 1),
    ],
)
def test_refuses(
    tmp_path: Path, square: str, refused: Callable[..., None], options: list[str], message: str, status: int
) -> None:
    for command in ("hog", "glyph", "invert"):
        refused(command, square, "-o", str(tmp_path / "out"), *options, message=message, status=status)


@pytest.mark.parametrize("name", ["dlib", "skimage", "aubry"])
def test_learning_takes_the_parameters_of_a_preset(
    tmp_path: Path, square: str, refused: Callable[..., None], name: str
) -> None:
    learn = ["--images", str(Path(square).parent), "-o", str(tmp_path / "x.npz"), "--preset", name]
    refused("learn", "hoggles", *learn, "--set", "a=b", message=f"--set: {name} has no parameter 'a', but")


def test_learning_for_a_preset(tmp_path: Path, square: str) -> None:
    out = tmp_path / "n.npz"
    options = ["--preset", "piotr", "--set", "orientations=6"]
    assert main(["learn", "background", "--images", str(Path(square).parent), "-o", str(out), *options]) == 0
    assert Background.load(out).spec == presets.piotr(orientations=6)
