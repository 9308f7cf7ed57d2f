"""`nablahog table1` with the models that its methods learn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from PIL import Image
from skimage import data

from nablahog.cli.main import main
from nablahog.paper import learned
from nablahog.paper.baselines import hoggles_learning
from nablahog.paper.baselines.bovw import BoVW
from nablahog.paper.learned import LEARNED
from nablahog.paper.photographs import sample_photographs

from ..common import names


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


@pytest.mark.usefixtures("here")
def test_files_of_models(
    tmp_path: Path, images: str, learned_files: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    out, kinds = tmp_path / "out", ("ridge", "nearest")
    files = [option for kind in kinds for option in (f"--{kind}", learned_files[kind])]
    command = ["table1", "--images", images, "-o", str(out), "--methods", "ridge,nearest", "--limit", "2"]
    assert main([*command, *files]) == 0
    printed = capsys.readouterr()
    rows = [line.split(",")[:2] for line in (out / "per_image.csv").read_text().splitlines()[1:]]
    assert rows == [[kind, f"{k}.png"] for kind in kinds for k in range(2)]
    assert all(kind in (out / "index.html").read_text() and kind in printed.out for kind in kinds)
    assert printed.err == ""
    assert (out / "failures.csv").read_text() == "image,method,reason\n"


def test_files_of_another_kind(
    tmp_path: Path, images: str, photo: str, learned_files: dict[str, str], refused: Callable[..., None]
) -> None:
    ridge, nearest = learned_files["ridge"], learned_files["nearest"]
    table = ["table1", "--images", images, "-o", str(tmp_path / "out")]
    refused(
        *table, "--ridge", nearest, message=f"{nearest}: expected a ridge regression, but the archive lacks weights"
    )
    refused(*table, "--nearest", ridge, message="expected a window database, but the archive lacks pixels, sizes")
    refused(*table, "--ridge", photo, message=f"{photo}: expected a ridge regression (.npz), but it cannot be read")
    refused(*table, "--bovw", photo, message=f"{photo}: expected a BoVW model (.npz), but it cannot be read")
    refused(*table, "--nearest", f"{nearest}x", message=f"{nearest}x: no such file")
    refused(*table, "--methods", "ridge", "--nearest", nearest, message="uses --nearest; these do: nearest")


@pytest.mark.parametrize("kind", ["ridge", "nearest"])
def test_other_cells(tmp_path: Path, images: str, kind: str, refused: Callable[..., None]) -> None:
    file = str(tmp_path / "four.npz")
    assert main(["learn", kind, "--images", images, "-o", file, "--cell", "4"]) == 0
    table = ["table1", "--images", images, "-o", str(tmp_path / "out"), f"--{kind}", file]
    message = "was learned for another spec: its cell_size is (4, 4), the uoctti descriptor's (8, 8)"
    refused(*table, message=message)
    refused(*table, message=f"{kind}: the ")


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


def test_learning_without_a_file_is_resumed(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    learner = LEARNED["hoggles"]
    monkeypatch.setattr(hoggles_learning, "REPORTED", 2)
    monkeypatch.setitem(LEARNED, "hoggles", replace(learner, learn=partial(learner.learn, atoms=20, iterations=7)))

    def stop(done: int, total: int, what: str) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learned.learned_from_samples("hoggles", stop)
    (checkpoint,) = names(cache)
    assert checkpoint.endswith(".npz.checkpoint")
    seen: list[int] = []
    path = learned.learned_from_samples("hoggles", lambda done, total, what: seen.append(done))
    assert seen == [0, 4, 5, 6, 7]
    assert names(cache) == [path.name] == [checkpoint.removesuffix(".checkpoint")]


def test_a_damaged_checkpoint_in_the_folder_for_caches(
    cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    learner = LEARNED["hoggles"]
    monkeypatch.setitem(LEARNED, "hoggles", replace(learner, learn=partial(learner.learn, atoms=20, iterations=3)))
    path = learned.learned_from_samples("hoggles", lambda done, total, what: None)
    path.rename(path.with_name(f"{path.name}.checkpoint"))
    assert learned.learned_from_samples("hoggles", lambda done, total, what: None) == path
    assert names(cache) == [path.name, f"{path.name}.checkpoint.damaged"]
    assert "starts afresh" in caplog.text


@pytest.mark.usefixtures("here")
def test_networks_of_two_descriptors(
    tmp_path: Path, images: str, refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    """Learned and used from the command; a row runs with its own file only."""
    presets = [("upconv", "uoctti"), ("dalal-upconv", "paper")]
    files = {name: str(tmp_path / f"{name}.npz") for name, _ in presets}
    for name, preset in presets:
        small = ["--epochs", "1", "--size", "40"]
        assert main(["learn", "upconv", "--images", images, "-o", files[name], "--preset", preset, *small]) == 0
    table, out = ["table1", "--images", images, "--limit", "1"], tmp_path / "out"
    both = [option for name, file in files.items() for option in (f"--{name}", file)]
    capsys.readouterr()
    assert main([*table, "-o", str(out), "--methods", "upconv,dalal-upconv", *both]) == 0
    printed = capsys.readouterr().out
    rows = [line.split(",")[:2] for line in (out / "per_image.csv").read_text().splitlines()[1:]]
    assert rows == [["upconv", "0.png"], ["dalal-upconv", "0.png"]]
    assert "The dalal-upconv file was learned from images of the same names as 1 of these" in printed
    to = ["-o", str(tmp_path / "other")]
    refused(*table, *to, "--methods", "dalal-upconv", "--upconv", files["upconv"], message="uses --upconv; these do: ")
    message = "dalal-upconv: the network was learned for another spec: its value_range is 255.0"
    refused(*table, *to, "--dalal-upconv", files["upconv"], message=message)
    message = "dalal-upconv needs --dalal-upconv FILE, see `nablahog learn upconv --preset paper`"
    refused(*table, *to, "--methods", "dalal-upconv", message=message)
