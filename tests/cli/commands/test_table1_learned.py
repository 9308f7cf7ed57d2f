"""`nablahog table1` with the models that its methods learn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from PIL import Image
from skimage import data

from nablahog import presets
from nablahog.cli.main import main
from nablahog.paper import learned
from nablahog.paper.baselines.bovw import BoVW
from nablahog.paper.baselines.hoggles_learning import learn_hoggles
from nablahog.paper.photographs import read_folder, sample_photographs


@pytest.fixture
def large_images(tmp_path: Path) -> str:
    """Photographs of 128x128 pixels with the 1024 windows that dictionaries are made of."""
    chelsea, folder = data.chelsea(), tmp_path / "large"
    folder.mkdir()
    for k in range(12):
        top, left = 80 * (k // 4), 100 * (k % 4)
        Image.fromarray(chelsea[top : top + 128, left : left + 128]).save(folder / f"{k}.png")
    return str(folder)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of models that are learned once from sample photographs, of which there are two."""
    monkeypatch.setattr(learned, "sample_photographs", partial(sample_photographs, limit=2))
    monkeypatch.setattr(learned, "cache_folder", lambda: tmp_path / "caches")
    return tmp_path / "caches"


def test_learned_by_default_numbers(tmp_path: Path, large_images: str, capsys: pytest.CaptureFixture[str]) -> None:
    pair, words, out = (str(tmp_path / name) for name in ("pair.npz", "words.npz", "out"))
    assert main(["learn", "hoggles", "--images", large_images, "-o", pair, "--fast"]) == 0
    assert main(["learn", "bovw", "--images", large_images, "-o", words]) == 0
    assert len(BoVW.load(words).learning.images) == 12
    options = ["--methods", "bovw,hoggles", "--bovw", words, "--hoggles", pair, "--limit", "2", "--workers", "1"]
    assert main(["table1", "--images", large_images, "-o", out, *options]) == 0
    printed = capsys.readouterr().out
    assert "1024 pairs of atoms, 12 images" in printed
    assert "The bovw file was learned from images of the same names as 2 of these" in printed
    assert (Path(out) / "failures.csv").read_text() == "image,method,reason\n"


def test_files_of_another_kind(
    tmp_path: Path, images: str, photo: str, learned_files: dict[str, str], refused: Callable[..., None]
) -> None:
    hoggles, bovw = learned_files["hoggles"], learned_files["bovw"]
    table = ["table1", "--images", images, "-o", str(tmp_path / "out")]
    refused(*table, "--hoggles", bovw, message=f"{bovw}: expected a dictionary pair, but the archive lacks ")
    refused(*table, "--bovw", photo, message=f"{photo}: expected a BoVW model (.npz), but it cannot be read")
    refused(*table, "--hoggles", f"{hoggles}x", message=f"{hoggles}x: no such file")
    refused(*table, "--methods", "hoggles", "--bovw", bovw, message="uses a file of bovw; these do: bovw")


def test_other_cells(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    file = str(tmp_path / "four.npz")
    learn_hoggles(read_folder(Path(images), size=0).images, presets.uoctti(4), atoms=8, fast=True).save(file)
    table = ["table1", "--images", images, "-o", str(tmp_path / "out"), "--hoggles", file]
    refused(*table, message="hoggles: the dictionary was learned for another spec: its cell_size is (4, 4)")


def test_without_a_file_it_is_learned_once(tmp_path: Path, large_images: str, cache: Path) -> None:
    command = ["table1", "--images", large_images, "--methods", "bovw", "--limit", "1", "--workers", "1"]
    assert main([*command, "-o", str(tmp_path / "a")]) == 0
    (model,) = cache.iterdir()
    when = model.stat().st_mtime_ns
    assert main([*command, "-o", str(tmp_path / "b")]) == 0
    assert model.stat().st_mtime_ns == when
    model.write_bytes(model.read_bytes()[:100])
    assert main([*command, "-o", str(tmp_path / "c")]) == 0
    assert BoVW.load(model).image_size == (128, 128)
    one, other = ((tmp_path / folder / "per_image.csv").read_text() for folder in "ac")
    assert one == other
