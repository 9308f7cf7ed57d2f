"""`nablahog learn hoggles` and `learn bovw`, and the table with what they learn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from skimage import data

from nablahog.cli.main import main
from nablahog.evaluate import learned
from nablahog.evaluate.photographs import sample_photographs
from nablahog.invert.baselines.bovw import BoVW
from nablahog.invert.baselines.hoggles import PairedDictionary


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Photographs of 128x128 pixels with the 1024 windows that dictionaries are made of."""
    chelsea, folder = data.chelsea(), tmp_path / "images"
    folder.mkdir()
    for k in range(12):
        top, left = 80 * (k // 4), 100 * (k % 4)
        Image.fromarray(chelsea[top : top + 128, left : left + 128]).save(folder / f"{k}.png")
    return str(folder)


def test_hoggles(tmp_path: Path, images: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "pair.npz"
    assert main(["learn", "hoggles", "--images", images, "-o", str(out), "--fast", "--cell", "4"]) == 0
    assert "1024 pairs of atoms, 12 images" in capsys.readouterr().out
    pair = PairedDictionary.load(out)
    assert (pair.spec.cell_size, pair.learning.iterations, len(pair.learning.images)) == ((4, 4), 0, 12)


def test_the_table_with_them(tmp_path: Path, images: str, capsys: pytest.CaptureFixture[str]) -> None:
    pair, words, out = (str(tmp_path / name) for name in ("pair.npz", "words.npz", "out"))
    assert main(["learn", "hoggles", "--images", images, "-o", pair, "--fast"]) == 0
    assert main(["learn", "bovw", "--images", images, "-o", words]) == 0
    assert len(BoVW.load(words).learning.images) == 12
    options = ["--methods", "bovw,hoggles", "--bovw", words, "--hoggles", pair, "--limit", "2", "--workers", "1"]
    assert main(["table1", "--images", images, "-o", out, *options]) == 0
    printed = capsys.readouterr().out
    assert "The bovw file was learned from images of the same names as 2 of these" in printed
    assert (Path(out) / "failures.csv").read_text() == "image,method,reason\n"


def test_without_a_file_it_is_learned_once(
    tmp_path: Path, images: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few = sample_photographs(size=256, limit=2, whole=True)
    monkeypatch.setattr(learned, "sample_photographs", lambda **all_of_them: few)
    monkeypatch.setattr(learned, "user_cache_path", lambda name: tmp_path / "caches" / name)
    command = ["table1", "--images", images, "--methods", "bovw", "--limit", "1", "--workers", "1"]
    assert main([*command, "-o", str(tmp_path / "a")]) == 0
    (kept,) = (tmp_path / "caches" / "nablahog").iterdir()
    when = kept.stat().st_mtime_ns
    assert main([*command, "-o", str(tmp_path / "b")]) == 0
    assert kept.stat().st_mtime_ns == when
    kept.write_bytes(kept.read_bytes()[:100])
    assert main([*command, "-o", str(tmp_path / "c")]) == 0
    assert BoVW.load(kept).image_size == (128, 128)
    one, other = ((tmp_path / folder / "per_image.csv").read_text() for folder in "ac")
    assert one == other


def test_refuses(tmp_path: Path, images: str, photo: str, refused: Callable[..., None]) -> None:
    out = ["-o", str(tmp_path / "x.npz")]
    refused("learn", "hoggles", "--images", images, "-o", str(tmp_path), message="expected -o FILE.npz")
    refused("learn", "hoggles", "--images", images, *out, "--size", "40", message="expected at least 56x56 pixels")
    refused("learn", "bovw", "--images", images, *out, "--size", "20", message="windows of 32x32 pixels")
    table = ["table1", "--images", images, "-o", str(tmp_path / "out")]
    refused(*table, "--bovw", photo, message="expected a")
    refused(*table, "--hoggles", photo, "--methods", "bovw", message="these do: hoggles")
    assert not (tmp_path / "x.npz").exists()
