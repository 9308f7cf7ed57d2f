"""Reading a folder: sorted, gray, shrunk; what is wrong is kept with its reason."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog.io.images import SAMPLE_NAMES
from nablahog.io.photographs import read_folder, sample_photographs

COLOURS = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(COLOURS).save(tmp_path / "b.png")
    Image.fromarray(COLOURS[:16, :16, 0]).save(tmp_path / "a.BMP")
    (tmp_path / "c.jpg").write_bytes(b"no image")
    (tmp_path / "d.png").write_bytes((tmp_path / "b.png").read_bytes()[:400])
    (tmp_path / "notes.txt").touch()
    (tmp_path / ".hidden.png").touch()
    (tmp_path / "below.png").mkdir()
    return tmp_path


def test_a_folder(folder: Path) -> None:
    read = read_folder(folder, size=30)
    assert list(read.images) == ["a.BMP", "b.png"]
    assert read.images["b.png"].shape == (20, 30)
    assert torch.equal(read.images["a.BMP"], torch.from_numpy(COLOURS[:16, :16, 0] / np.float32(255)))
    assert list(read.failed) == ["c.jpg", "d.png"]
    assert read.failed["c.jpg"].startswith("expected an image, got a file")
    assert read.failed["d.png"].startswith("the image cannot be read")
    assert read.ignored == ["below.png", "notes.txt"]


@pytest.mark.slow
def test_folders_below(folder: Path) -> None:
    for name in ("chairs", "below.png/more", ".hidden"):
        (folder / name).mkdir(parents=True)
        Image.fromarray(COLOURS).save(folder / name / "1.png")
    (folder / "chairs" / "loop").symlink_to(folder, target_is_directory=True)
    read = read_folder(folder, size=0, recursive=True)
    assert list(read.images) == ["a.BMP", "b.png", "below.png/more/1.png", "chairs/1.png"]
    assert list(read.failed) == ["c.jpg", "d.png"]
    assert read.ignored == ["chairs/loop", "notes.txt"]
    expected = COLOURS.astype(np.float32) / 255 @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    torch.testing.assert_close(read.images["b.png"], torch.from_numpy(expected))


def _make_below(path: Path) -> None:
    """An empty folder, one with images, and a file that is none."""
    for name in ("dev", "assets"):
        (path / name).mkdir(parents=True)
    (path / "dev" / "1.png").touch()
    (path / "a.txt").touch()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda path: None, FileNotFoundError, "no such folder"),
        (lambda path: path.touch(), NotADirectoryError, "expected a folder of images, got a file"),
        (lambda path: path.mkdir(), ValueError, "it holds none$"),
        (_make_below, ValueError, "only its subfolders do: write .*dev$"),
    ],
)
def test_no_images(tmp_path: Path, make: object, error: type[Exception], message: str) -> None:
    assert callable(make)
    make(tmp_path / "x")
    with pytest.raises(error, match=f"^{re.escape(str(tmp_path / 'x'))}: .*{message}$"):
        read_folder(tmp_path / "x", size=0)


def test_those_of_scikit_image() -> None:
    read = sample_photographs(size=64)
    assert tuple(read.images) == SAMPLE_NAMES
    assert {tuple(image.shape) for image in read.images.values()} == {(64, 64)}
    assert all(image.min() >= 0 and image.max() <= 1 and image.std() > 0.05 for image in read.images.values())
    assert list(sample_photographs(size=64, limit=2).images) == list(SAMPLE_NAMES[:2])
    whole = sample_photographs(size=64, limit=4, whole=True).images
    assert whole["chelsea"].shape == (43, 64)
