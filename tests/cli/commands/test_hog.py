"""``nablahog hog`` and ``nablahog glyph``."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import nablahog
from nablahog import HOGSpec, presets
from nablahog.cli.main import main
from nablahog.invert.prior.choice import PriorChoice, default_prior_file
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import Picture, read_image, to_pil
from nablahog.requests.dialect import PRESETS, make_spec
from nablahog.viz.pictures import glyphs

from ..common import CHELSEA, names


def test_hog_writes_the_descriptor_with_its_spec(tmp_path: Path, photo: str) -> None:
    out = tmp_path / "new" / "d.npz"
    options = ["--preset", "paper", "--set", "cell_size=8x6", "--size", "64"]
    for given, spec, size in (([], presets.uoctti(8), (60, 80)), (options, presets.paper((8, 6)), (48, 64))):
        assert main(["hog", photo, "-o", str(out), *given]) == 0
        stored = load_descriptor(out)
        assert (stored.spec, stored.image_size) == (spec, size)


def test_hog_of_several_makes_a_folder(tmp_path: Path, photo: str) -> None:
    (tmp_path / "in2").mkdir()
    Image.fromarray(CHELSEA[:48, :64]).save(tmp_path / "in2" / "cat.jpg")
    assert main(["hog", photo, str(tmp_path / "in2" / "cat.jpg"), "-o", str(tmp_path / "out")]) == 0
    shapes = {load_descriptor(tmp_path / "out" / name).descriptor.shape for name in names(tmp_path / "out")}
    assert len(names(tmp_path / "out")) == 2
    assert (6, 8, 31) in shapes
    assert main(["hog", photo, "-o", str(tmp_path / "new") + os.sep]) == 0
    assert names(tmp_path / "new") == ["cat.npz"]


def test_glyph(tmp_path: Path, photo: str, descriptor: str) -> None:
    assert main(["glyph", photo, "-o", str(tmp_path / "g.png"), "--size", "64"]) == 0
    assert read_image(tmp_path / "g.png").shape == (1, 6 * 16, 8 * 16)
    assert main(["glyph", photo, descriptor, "-o", str(tmp_path / "out")]) == 0
    assert names(tmp_path / "out") == ["cat_glyphs.png", "stored_glyphs.png"]


def test_subfolders_that_are_left_out_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in (tmp_path / "in", tmp_path / "in" / "more"):
        folder.mkdir()
        Image.new("L", (32, 32), 9).save(folder / "a.png")
    assert main(["hog", str(tmp_path / "in"), "-o", str(tmp_path / "out")]) == 0
    assert "1 subfolder left out, such as more" in capsys.readouterr().err
    assert main(["hog", str(tmp_path / "in"), "-o", str(tmp_path / "in" / "more")]) == 0
    assert "subfolder" not in capsys.readouterr().err


SIZE = (56, 64)
QUICK = ("skimage", "opencv-set")
"""The others are slow tests."""
OPTIONS: dict[str, tuple[list[str], HOGSpec]] = {
    **{name: (["--preset", name], make_spec(name, {})) for name in PRESETS},
    "opencv-set": (
        ["--preset", "opencv", "--set", "win_size=64x56", "--set", "block_stride=16x8", "--set", "gamma=false"],
        presets.opencv((64, 56), block_stride=(16, 8), gamma=False),
    ),
}


@pytest.fixture
def square(tmp_path: Path) -> str:
    """A colour photograph of 56x64 pixels."""
    (tmp_path / "in").mkdir(exist_ok=True)
    Image.fromarray(CHELSEA[:56, 8:72]).save(tmp_path / "in" / "photo.png")
    return str(tmp_path / "in" / "photo.png")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.xslow]) for name in OPTIONS]
)
def test_there_and_back(tmp_path: Path, square: str, name: str) -> None:
    options, spec = OPTIONS[name]
    stored, array, out = tmp_path / "d.npz", tmp_path / "d.npy", tmp_path / "out"
    assert main(["hog", square, "-o", str(stored), *options]) == 0
    loaded = load_descriptor(stored)
    image = read_image(square)[None]
    assert (loaded.spec, loaded.image_size) == (spec, SIZE)
    assert torch.equal(loaded.descriptor, nablahog.hog(image, spec)[0])

    # the library's own array of the same image is drawn and inverted alike
    np.save(array, nablahog.hog(image, spec, layout="native")[0].numpy())
    options += ["--image-size", "56x64"]
    assert main(["glyph", str(array), "-o", str(tmp_path / "g.png"), *options]) == 0
    assert _levels(tmp_path / "g.png") == _levels(glyphs(loaded.descriptor, spec))
    assert main(["invert", str(array), "-o", str(out), *options, "--quality", "fast"]) == 0
    prior: PriorChoice = "default" if default_prior_file(spec) else None
    result = nablahog.reconstruct(loaded.descriptor[None], spec, SIZE, prior=prior, quality="fast")
    assert _levels(out / "d_preimage.png") == _levels(result.image[0])
    (figures,) = json.loads((out / "results.json").read_text())
    assert (figures["descriptor"], figures["image_size"], figures["cc"]) == (spec.name, list(SIZE), None)
    assert figures["distance"] == pytest.approx(float(result.distance[0]))


def _levels(picture: Path | Picture) -> bytes:
    return (Image.open(picture) if isinstance(picture, Path) else to_pil(picture)).tobytes()
