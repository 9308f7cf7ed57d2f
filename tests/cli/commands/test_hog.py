"""``nablahog hog`` and ``nablahog glyph``."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from PIL import Image

import nablahog
from nablahog import presets
from nablahog.cli.main import main
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image

from ..common import CHELSEA, names


def test_hog_writes_the_descriptor_with_its_spec(tmp_path: Path, photo: str) -> None:
    out = tmp_path / "new" / "d.npz"
    options = ["--preset", "paper", "--set", "cell_size=8x6", "--size", "64"]
    for given, spec, size in (([], presets.uoctti(8), (60, 80)), (options, presets.paper((8, 6)), (48, 64))):
        assert main(["hog", photo, "-o", str(out), *given]) == 0
        stored = load_descriptor(out)
        assert (stored.spec, stored.image_size) == (spec, size)
    assert main(["hog", photo, "-o", str(out)]) == 0
    expected = nablahog.hog(read_image(photo)[None], presets.uoctti(8))[0]
    torch.testing.assert_close(load_descriptor(out).descriptor, expected)


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
