"""The command as people misuse it: one line on stderr, a status other than 0, nothing on disk."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import presets
from nablahog.cli.main import main

from .common import CHELSEA, FAST

BAD_PHOTOS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: path.unlink(), "no such file"),
    "an empty folder": (lambda path: (path.unlink(), path.mkdir()), "expected a file, or a folder of files"),
    "smaller than a cell": (lambda path: Image.fromarray(CHELSEA[:3]).save(path), "at least one cell of 8x8 pixels"),
}


@pytest.mark.parametrize("what", BAD_PHOTOS)
def test_bad_photographs(tmp_path: Path, photo: str, refused: Callable[..., None], what: str) -> None:
    make, message = BAD_PHOTOS[what]
    make(Path(photo))
    for command in ("hog", "invert"):
        refused(command, photo, "-o", str(tmp_path / "out"), message=f"{photo}: ")
        refused(command, photo, "-o", str(tmp_path / "out"), message=message)


def _arrays(path: Path, **changed: Any) -> None:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {**archive, **changed}
    np.savez(path, **arrays)


def test_descriptor_files_of_another_spec_than_asked_for(
    tmp_path: Path, descriptor: str, refused: Callable[..., None]
) -> None:
    out = ["-o", str(tmp_path / "out")]
    refused("invert", descriptor, *out, "--preset", "paper", message="its name is 'uoctti', not 'paper'")
    refused("glyph", descriptor, *out, "--set", "vote=hard", message="its vote is 'linear', not 'hard'")
    assert main(["glyph", descriptor, *out, "--preset", "uoctti", "--set", "cell_size=8"]) == 0


@pytest.mark.parametrize("command", ["hog", "glyph", "invert", "demo"])
def test_output_folders_that_cannot_be(
    photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    module = "demo" if command == "demo" else "invert"
    monkeypatch.setattr(f"nablahog.cli.commands.{module}.invert_batch", None)  # it must fail before any work
    inputs = [] if command == "demo" else [photo, photo]
    refused(command, *inputs, "-o", f"{photo}/out", message="is not a folder")
    refused(command, *inputs, "-o", "", message="expected the name of a file or folder, got ''", status=2)


def test_inputs_are_not_overwritten(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    refused("hog", photo, "-o", photo, message="would overwrite an input")
    beside = tmp_path / "in" / "cat_preimage.png"
    Image.fromarray(CHELSEA).save(beside)
    refused("invert", photo, str(beside), "-o", str(tmp_path / "in"), *FAST, message="would overwrite an input")


def test_one_file_for_several_inputs(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    for command, name in [("hog", "d.npz"), ("glyph", "g.png")]:
        refused(command, photo, photo, "-o", str(tmp_path / name), message="several inputs need a folder", status=2)
    refused("glyph", photo, "-o", str(tmp_path / "g.jpg"), message="glyphs are written as PNG", status=2)
    for name in ("d.npy", "d.png"):
        refused("hog", photo, "-o", str(tmp_path / name), message="descriptors are written as .npz", status=2)


def test_errors_are_one_short_printable_line(
    tmp_path: Path, descriptor: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fields = json.loads(presets.uoctti().to_json())
    _arrays(Path(descriptor), spec=np.array(json.dumps(fields | {"border": "\x1b[31m" * 20_000})))
    argv = ["glyph", descriptor, "-o", str(tmp_path / "out")]
    capsys.readouterr()
    for wrong in (argv, ["glyph", "a\x1b[31m\u202eb", *argv[2:]], [*argv, "--key", "x" * 5000, "--\x1b[31m"]):
        assert main(wrong) in (1, 2)
        printed = capsys.readouterr().err
        assert len(printed) <= 1001
        assert printed.removesuffix("\n").isprintable()


@pytest.mark.parametrize(
    ("options", "status"),
    [
        (["--size", "-1"], 2),
        (["--device", "tpu"], 2),
        (["--preset", "sift"], 2),
        (["--set", "orientations"], 2),
        (["-o", "-"], 2),
        (["--wat"], 2),
        (["--set", "nbins=8"], 1),
        (["--preset", "opencv", "--set", "cell_size=6"], 2),
        (["--size", "4"], 1),
        (["--method", "paper", "--quality", "fast"], 2),
        (["--template", "--samples", "2"], 2),
        (["--samples", "2", "--prior", "none"], 2),
    ],
)
def test_bad_options(tmp_path: Path, photo: str, refused: Callable[..., None], options: list[str], status: int) -> None:
    refused("invert", photo, "-o", str(tmp_path / "out"), *options, message="", status=status)


def test_no_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "COMMAND" in capsys.readouterr().err


def test_cuda_asked_for_and_absent(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["invert", photo, "-o", str(tmp_path / "out"), "--device"]
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    refused(*options, "cuda", message="expected a CUDA device for cuda", status=2)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    refused(*options, "cuda:1", message="cuda:0 … cuda:0", status=2)


@pytest.mark.parametrize(
    ("module", "command", "message"),
    [
        ("uvicorn", "app", "the page needs uvicorn: pip install scikit-image starlette uvicorn"),
        ("skimage", "demo -o demo", "a sample photograph needs skimage: pip install scikit-image"),
        ("dask", "hog cat.png -o o.parquet --cluster local:1", "a cluster needs dask: pip install dask distributed"),
    ],
)
def test_without_an_extra(
    photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, module: str, command: str, message: str
) -> None:
    monkeypatch.chdir(Path(photo).parent)
    monkeypatch.delitem(sys.modules, "nablahog.jobs.cluster", raising=False)
    monkeypatch.setitem(sys.modules, module, None)
    refused(*command.split(), message=message)
