"""Every preset by the command: a photograph's descriptor, its picture, and an image from it alone."""

from __future__ import annotations

import json
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

from ..common import CHELSEA

SIZE = (56, 64)
QUICK = ("paper", "dpm", "skimage", "maskfeat", "opencv-set")
"""One of each layout; the others are slow tests."""
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


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in OPTIONS]
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
