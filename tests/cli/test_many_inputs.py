"""Folders, patterns, stdin and stdout; bad inputs among good ones."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from nablahog import HOGSpec, presets
from nablahog.cli.commands import invert
from nablahog.cli.main import main
from nablahog.cli.results import inversion
from nablahog.io.descriptor_file import load_descriptor
from nablahog.requests.sources import Source

from .common import CHELSEA, FAST, names


@pytest.fixture
def mixed(images: str) -> Path:
    """Three photographs, 0.png … 2.png, a damaged one and a text."""
    folder = Path(images)
    (folder / "1a.png").write_text("hello")
    (folder / "notes.txt").write_text("hello")
    (folder / ".hidden.png").write_text("hello")
    return folder


def test_a_folder_is_all_its_images(tmp_path: Path, mixed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hog", str(mixed), "-o", str(tmp_path / "out")]) == 3
    assert names(tmp_path / "out") == ["0.npz", "1.npz", "2.npz"]
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"nablahog hog: skipped: {mixed / '1a.png'}: expected an image")


@pytest.mark.parametrize("command", ["hog", "glyph", "invert"])
def test_colours_that_scikit_image_would_use_are_named_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setattr(invert, "invert_batch", _no_inversion)
    monkeypatch.chdir(tmp_path)
    for mode, settings, loses in (("RGB", [], 1), ("L", [], 0), ("RGB", ["--set", "channel_axis=-1"], 0)):
        for name in ("a.png", "b.png"):
            Image.fromarray(CHELSEA).convert(mode).save(name)
        main([command, "a.png", "b.png", "-o", "out/", "--preset", "skimage", *settings])
        assert capsys.readouterr().err.count("--set channel_axis=-1") == loses


def test_patterns(tmp_path: Path, mixed: Path, photo: str) -> None:
    assert main(["hog", str(mixed / "[12].png"), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    assert names(tmp_path / "out") == ["1.npz", "2.npz"]
    os.rename(photo, odd := Path(photo).with_name("[a]*.png"))  # a file may be called like a pattern
    assert main(["hog", str(odd), "-o", str(tmp_path / "d")]) == 0
    assert (tmp_path / "d").is_file()


def test_results_say_what_was_skipped_and_why(
    tmp_path: Path, mixed: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = invert.invert_batch

    def second_fails(sources: Sequence[Source], *asked: Any, **options: Any) -> Any:
        if any(source.stem == "1" for source in sources):
            raise ValueError("it cannot be inverted")
        return real(sources, *asked, **options)

    monkeypatch.setattr(invert, "invert_batch", second_fails)  # in a batch with the others
    out, missing = tmp_path / "out", str(tmp_path / "missing.png")
    assert main(["invert", str(mixed), missing, "-o", str(out), *FAST]) == 3
    results = json.loads((out / "results.json").read_text())
    inputs = [Path(each["input"]).name for each in results]
    assert inputs == ["0.png", "2.png", "1a.png", "missing.png", "1.png"]
    assert all("error" not in each and each["cc"] is not None for each in results[:2])
    assert all(each["error"] for each in results[2:])
    assert results[-1]["error"] == "it cannot be inverted"
    assert capsys.readouterr().err.count("nablahog invert: skipped: ") == 3
    assert "1a.png" in (out / "index.html").read_text()


def test_nothing_can_be_done(
    tmp_path: Path, mixed: Path, refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    to = ["-o", str(tmp_path / "out")]
    refused("hog", str(mixed / "1a.png"), *to, message="1a.png: expected an image")
    refused("hog", str(mixed / "*.jpg"), *to, message="*.jpg: no file matches this pattern")
    refused("hog", str(mixed), "-o", str(mixed), message="would be its inputs next time")
    assert main(["hog", str(mixed / "1a.png"), str(mixed / "no.png"), *to]) == 1
    assert capsys.readouterr().err.endswith("nablahog hog: error: none of the 2 inputs can be used\n")
    assert not (tmp_path / "out").exists()


@pytest.fixture
def large(tmp_path: Path) -> Path:
    """Two photographs of 300x400 pixels in a folder."""
    folder = tmp_path / "large"
    folder.mkdir()
    for name in ("a.png", "b.png"):
        Image.fromarray(CHELSEA).resize((400, 300)).save(folder / name)
    return folder


@pytest.mark.parametrize(("command", "shrinks"), [("hog", False), ("glyph", True), ("invert", True)])
def test_only_what_takes_time_shrinks_photographs_and_says_so(
    large: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str, shrinks: bool
) -> None:
    """Of a file, a folder, a pattern and standard input."""
    monkeypatch.setattr(invert, "invert_batch", _no_inversion)
    monkeypatch.chdir(large)
    content = (large / "a.png").read_bytes()
    for given in ("a.png", ".", "*.png", "-"):
        shapes = []
        for options in ([], ["--size", "0"]):
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
            assert main([command, given, "-o", "out/", "--preset", "paper", *options]) in (0, 1)
            printed = capsys.readouterr()
            assert ("shrunk to 256 pixels; --size 0 keeps" in printed.err) == (shrinks and not options)
            shapes.append(set(re.findall(r"(?<=\s)\d+x\d+(?=\s)", printed.out + printed.err)))
        assert shapes == [{"192x256"} if shrinks else {"300x400"}, {"300x400"}]


def _no_inversion(sources: Sequence[Source], *asked: Any, **options: Any) -> Any:
    raise ValueError("{}x{} pixels".format(*sources[0].image_size))


def test_inputs_on_both_sides_of_the_options(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    out = tmp_path / "out"
    assert main(["hog", photo, "-o", str(out), "--size", "64", photo, "-q", photo]) == 0
    assert len(list(out.iterdir())) == 3
    refused("hog", photo, "-o", str(out), "", message="unrecognized", status=2)
    for name in ("https://host/a.png", "@list.txt"):
        refused("hog", name, "-o", str(tmp_path / "d"), message="URLs and lists are read by")


def test_quiet(tmp_path: Path, photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hog", photo, "-o", str(tmp_path / "d.npz"), "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["hog", photo, "-o", str(tmp_path / "d.npz")]) == 0  # quiet no longer
    assert "uoctti" in capsys.readouterr().out


@pytest.mark.slow
def test_stdin_and_stdout(tmp_path: Path, photo: str) -> None:
    command = [sys.executable, "-m", "nablahog"]
    piped = subprocess.run(
        [*command, "hog", "-", "-o", "-"], input=Path(photo).read_bytes(), capture_output=True, check=True
    )
    assert piped.stderr == b""
    (tmp_path / "piped.npz").write_bytes(piped.stdout)
    assert main(["hog", photo, "-o", str(tmp_path / "named.npz")]) == 0
    one, other = (load_descriptor(tmp_path / f"{name}.npz") for name in ("piped", "named"))
    assert one.descriptor.equal(other.descriptor)
    drawn = subprocess.run([*command, "glyph", "-", "-o", "-"], input=piped.stdout, capture_output=True, check=True)
    with Image.open(io.BytesIO(drawn.stdout)) as glyphs:
        assert glyphs.size == (160, 128)


def test_stdin_as_it_should_not_be(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    to = ["-o", str(tmp_path / "out")]
    for content, message in ((b"", "-: expected a file of 1 … "), (b"hello", "-: expected an image")):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
        refused("hog", "-", *to, message=message)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    refused("hog", "-", *to, message="-: expected a file on stdin, got a terminal")
    refused("hog", "-", "-", *to, message="stdin can be read once", status=2)
    refused(
        "hog", photo, photo, "-o", "-", message="several inputs need a folder: expected -o DIR, got stdout", status=2
    )


def test_batches_hold_one_spec_and_size_and_not_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    def source(rows: int, spec: HOGSpec) -> Source:
        size = (8 * rows, 8)
        return Source("p", "p", torch.zeros(rows, 1, spec.channels), spec, size, None)

    one, other = presets.paper(), presets.uoctti()
    sources = [source(1, one), source(2, one), source(1, other), source(1, one), source(1, one)]
    assert inversion.batches(sources) == [[0, 3, 4], [1], [2]]
    monkeypatch.setattr(inversion, "BATCH_PIXELS", 130)
    assert inversion.batches(sources) == [[0, 3], [4], [1], [2]]
