"""``nablahog invert --colour``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage import data

from nablahog.cli.main import main

OPTIONS = ["--max-evaluations", "30"]


@pytest.fixture
def photograph(tmp_path: Path) -> str:
    path = tmp_path / "astronaut.png"
    Image.fromarray(data.astronaut()[:96, 160:256]).resize((48, 48)).save(path)
    return str(path)


@pytest.mark.parametrize("preset", ["uoctti", "maskfeat"])
def test_colour(tmp_path: Path, photograph: str, preset: str) -> None:
    command = ["invert", photograph, "--preset", preset, *OPTIONS, "-o"]
    assert main([*command, str(tmp_path / "colour"), "--colour"]) == 0
    assert main([*command, str(tmp_path / "gray")]) == 0
    with Image.open(tmp_path / "colour" / "astronaut_preimage.png") as picture:
        assert (picture.mode, picture.size) == ("RGB", (48, 48))
        pixels = np.asarray(picture, float)
    assert np.ptp(pixels, axis=2).max() > 1
    coloured, plain = (json.loads((tmp_path / name / "results.json").read_text())[0] for name in ("colour", "gray"))
    assert coloured["distance"] < plain["distance"]
    assert coloured["cc"] is not None


def test_refusals(tmp_path: Path, photograph: str, refused: Callable[..., None]) -> None:
    output = ["-o", str(tmp_path / "out")]
    refused(
        *("invert", photograph, "--preset", "paper", "--colour", *output),
        message="a paper descriptor is of gray images, and has no pre-image in colour",
    )
    refused(
        *("invert", photograph, "--colour", "--prior", "p.npz", *output),
        message="--colour and --prior exclude each other",
    )
