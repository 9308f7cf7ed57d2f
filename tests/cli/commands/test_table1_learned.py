"""`nablahog table1` with the models that its methods learn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from nablahog.cli.main import main
from nablahog.io.photographs import sample_photographs
from nablahog.paper import learned
from nablahog.paper.learned import LEARNED


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of models that are learned once from sample photographs, of which there are two."""
    monkeypatch.setattr(learned, "sample_photographs", partial(sample_photographs, limit=2))
    monkeypatch.setattr(learned, "cache_folder", lambda: tmp_path / "caches")
    return tmp_path / "caches"


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
