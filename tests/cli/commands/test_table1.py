"""`nablahog table1` as people use and misuse it; interrupted and killed it is in ``tests/fuzz/test_kills.py``."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli.commands.tables import _photographs
from nablahog.cli.main import main
from nablahog.io.photographs import sample_photographs
from nablahog.paper import learned
from nablahog.paper.learned import LEARNED

from ..common import CHELSEA, names

TABLES = ["failures.csv", "index.html", "per_image.csv", "summary.csv", "times.csv"]
QUICK = ["--methods", "dalal-multi-scale,dalal-single", "--max-evaluations", "60", "--size", "32", "--workers", "1"]


@pytest.fixture
def five(tmp_path: Path) -> str:
    """Five small photographs and a file that is none."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(5):
        Image.fromarray(CHELSEA[4 * k : 4 * k + 32, 8 * k : 8 * k + 32]).save(folder / f"{k}.png")
    (folder / "x.png").write_bytes(b"no image")
    (folder / "notes.txt").touch()
    return str(folder)


def test_the_command(tmp_path: Path, five: str, here: None, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["table1", "--images", five, "-o", str(out), *QUICK, "--max-evaluations", "3", "--limit", "6"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in (
        "dalal-single",
        "Ran: ",
        str(out / "index.html"),
        "Failed: x.png, all methods: expected an image",
        "notes.txt",
    ):
        assert text in printed.out
    assert "hoggles" not in printed.out  # which was not asked for
    assert names(out) == [*TABLES, "work"]
    assert "6 images of the folder images." in (out / "index.html").read_text()


def test_a_part_of_a_folder_is_said_to_be_one(five: str) -> None:
    for limit, count in ((2, "The first 2 of 6 images"), (None, "6 images")):
        assert _photographs(Namespace(images=five, size=32, limit=limit))[1] == f"{count} of the folder images."


def test_what_it_refuses(tmp_path: Path, five: str, refused: Callable[..., None]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes.txt").touch()
    to = ["table1", "-o", str(tmp_path / "out")]
    refused(*to, "--methods", "dalal-single,hog", message="expected methods such as hoggles, ", status=2)
    refused(*to, "--learned", "prior", message="expected KIND=FILE", status=2)
    refused(*to, "--images", str(tmp_path / "empty"), message="expected a folder of images, but it holds none")
    refused(*to, "--images", five, "--learned", f"prior={five}/no", message="no such file")
    options = ["--learned", f"prior={five}/0.png", "--methods", "dalal-single"]
    refused(*to, "--images", five, *options, message="these do: uoctti-learned", status=2)


def test_no_result_at_all(tmp_path: Path, five: str, here: None, refused: Callable[..., None]) -> None:
    for name in os.listdir(five):
        Path(five, name).write_bytes(b"no image")
    message = "no image has a result; the first: 0.png: expected an image"
    refused("table1", "--images", five, "-o", str(tmp_path / "out"), *QUICK, message=message)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of models that are learned once from sample photographs, of which there are two."""
    monkeypatch.setattr(learned, "sample_photographs", partial(sample_photographs, limit=2))
    monkeypatch.setattr(learned, "cache_folder", lambda: tmp_path / "caches")
    return tmp_path / "caches"


def test_models_are_learned_from_whole_photographs() -> None:
    shapes = {name: tuple(image.shape) for name, image in learned.sample_training_photographs("hoggles").items()}
    assert (shapes["astronaut"], shapes["chelsea"]) == ((512, 512), (300, 451))


@pytest.mark.usefixtures("here")
def test_files_of_models(tmp_path: Path, images: str, learned_files: dict[str, str]) -> None:
    out, files = tmp_path / "out", ["--learned", f"hoggles={learned_files['hoggles']}"]
    command = ["table1", "--images", images, "-o", str(out), "--methods", "hoggles", "--limit", "2", *files]
    assert main(command) == 0
    rows = [line.split(",")[:2] for line in (out / "per_image.csv").read_text().splitlines()[1:]]
    assert rows == [["hoggles", f"{k}.png"] for k in range(2)]
    assert (out / "failures.csv").read_text() == "image,method,reason\n"


def test_files_of_another_kind(
    tmp_path: Path, images: str, photo: str, learned_files: dict[str, str], refused: Callable[..., None]
) -> None:
    hoggles, words = learned_files["hoggles"], learned_files["bovw"]
    table = ["table1", "--images", images, "-o", str(tmp_path / "out")]
    refused(*table, "--learned", f"hoggles={words}", message=f"{words}: expected a ")
    refused(*table, "--learned", f"bovw={photo}", message=f"{photo}: expected a BoVW model (.npz)")
    refused(*table, "--learned", f"bovw={words}x", message=f"{words}x: no such file")
    refused(*table, "--methods", "bovw", "--learned", f"hoggles={hoggles}", message="these do: hoggles", status=2)


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_without_a_file_it_is_learned_once(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = replace(LEARNED["hoggles"], learn=partial(LEARNED["hoggles"].learn, atoms=8, iterations=1))
    monkeypatch.setitem(LEARNED, "hoggles", few)
    command = ["table1", "--methods", "hoggles", "--limit", "1"]
    assert main([*command, "-o", str(tmp_path / "a")]) == 0
    (model,) = cache.iterdir()
    when = model.stat().st_mtime_ns
    assert main([*command, "-o", str(tmp_path / "b")]) == 0
    assert model.stat().st_mtime_ns == when
    model.write_bytes(model.read_bytes()[:100])
    assert main([*command, "-o", str(tmp_path / "c")]) == 0
    one, other = ((tmp_path / folder / "per_image.csv").read_text() for folder in "ac")
    assert one == other
