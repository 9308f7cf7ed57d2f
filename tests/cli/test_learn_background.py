"""`nablahog learn background` as people use and misuse it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from PIL import Image

from nablahog import presets
from nablahog.cli.main import main
from nablahog.evaluate.photographs import read_folder
from nablahog.pose.background import learn_background
from nablahog.pose.whitening import Background

from .common import CHELSEA, names

SMALL = ["--cell", "4", "--order", "3"]


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Three small photographs."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA[5 * k : 5 * k + 36, 8 * k : 8 * k + 40]).save(folder / f"{k}.png")
    return str(folder)


def test_learning(tmp_path: Path, images: str, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(CHELSEA[:23]).save(Path(images, "low.png"))
    Path(images, "x.png").write_bytes(b"no image")
    Path(images, "notes.txt").touch()
    out = tmp_path / "new" / "background.npz"
    assert main(["learn", "background", "--images", images, "-o", str(out), *SMALL]) == 0
    found = Background.load(out)
    assert found.spec == presets.aubry(4)
    assert (found.order, found.images) == (3, ("0.png", "1.png", "2.png"))
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.splitlines() == [
        "Passed over: x.png: expected an image, got a file of no format that Pillow reads",
        "Passed over: low.png: expected at least 24x24 pixels, got 23x80",
        "Passed over, as no images by their endings: notes.txt",
        f"Background in {out}: 3 images, 9 channels, templates of up to 4x4 cells",
    ]
    assert names(tmp_path / "new") == ["background.npz"]
    read = read_folder(Path(images), size=0).images
    del read["low.png"]
    assert torch.equal(found.covariance, learn_background(read, presets.aubry(4), order=3).covariance)


@pytest.mark.parametrize(
    ("options", "spec"),
    [
        (["--descriptor", "uoctti"], presets.uoctti(4)),
        (["--vote", "hard"], presets.aubry(4, vote="hard")),
        (["--cell", "4x5"], presets.aubry((4, 5))),
    ],
)
def test_other_descriptors(tmp_path: Path, images: str, options: list[str], spec: object) -> None:
    out = tmp_path / "b.npz"
    assert main(["learn", "background", "--images", images, "-o", str(out), *SMALL, *options]) == 0
    assert Background.load(out).spec == spec


def test_the_photographs_of_scikit_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learn", "background", "-o", str(tmp_path / "b.npz"), "--size", "60", *SMALL]) == 0
    assert "8 images, 9 channels" in capsys.readouterr().out


def test_bad_inputs(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    learn = ["learn", "background", "--images"]
    to = ["-o", str(tmp_path / "out" / "b.npz")]
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(*learn, f"{images}x", *to, message=f"{images}x: no such folder")
    refused(*learn, str(empty), *to, message="expected a folder of images, but it holds none")
    message = f"{images}: no image is usable; the first: 0.png: expected at least 96x96 pixels, got 36x40"
    refused(*learn, images, *to, message=message)
    refused(*learn, images, *to, "--descriptor", "paper", message="locally normalised descriptors only")
    refused(*learn, images, "-o", str(tmp_path / "b.png"), message="a background is one file: expected -o FILE.npz")
    refused(*learn, images, "-o", f"{images}/0.png/b.npz", *SMALL, message="is not a folder")
    refused(*learn, images, *to, "--order", "101", message="at most 100, got '101'", status=2)
