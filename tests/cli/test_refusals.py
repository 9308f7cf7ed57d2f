"""The command as people misuse it: one line on stderr, a status other than 0, nothing on disk."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import presets
from nablahog.cli.commands import invert
from nablahog.cli.main import main
from nablahog.io.descriptor_file import load_descriptor, save_descriptor

from .common import CHELSEA, FAST


def _truncated(path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])


def _bomb(path: Path) -> None:
    Image.new("1", (1, 1)).save(path, "BMP")
    header = bytearray(path.read_bytes())
    header[18:26] = (12_000).to_bytes(4, "little") + (9_000).to_bytes(4, "little")  # what it claims
    path.write_bytes(header)


def _tiny(path: Path) -> None:
    Image.fromarray(CHELSEA[:3]).save(path)


BAD_PHOTOS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: path.unlink(), "no such file"),
    "a folder": (
        lambda path: (path.unlink(), path.mkdir()),
        "expected a file, or a folder of files of these kinds: .apng",
    ),
    "empty": (lambda path: path.write_bytes(b""), "expected an image, got a file of no format that Pillow reads"),
    "no image": (lambda path: path.write_text("hello"), "expected an image, got a file of no format that Pillow reads"),
    "truncated": (_truncated, "the image cannot be read"),
    "a bomb": (_bomb, "more than 89,478,485 pixels"),
    "smaller than a cell": (_tiny, "at least one cell of 8x8 pixels (height x width), got an image of 3x80"),
}


@pytest.mark.parametrize("command", ["hog", "glyph", "invert"])
@pytest.mark.parametrize("what", BAD_PHOTOS)
def test_bad_photographs(tmp_path: Path, photo: str, refused: Callable[..., None], command: str, what: str) -> None:
    bad = tmp_path / "in" / "bad.png"
    bad.write_bytes(Path(photo).read_bytes())
    make, message = BAD_PHOTOS[what]
    make(bad)
    refused(command, str(bad), "-o", str(tmp_path / "out"), message=f"{bad}: ")
    refused(command, str(bad), "-o", str(tmp_path / "out"), message=message)


def test_shrunk_below_a_cell(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    refused("invert", photo, "-o", str(tmp_path / "o"), "--size", "4", message="3x4 after shrinking it to 4 pixels")


def _arrays(path: Path, **changed: Any) -> None:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {**archive, **changed}
    np.savez(path, **arrays)


def _value(path: Path, value: float) -> None:
    descriptor = load_descriptor(path).descriptor.numpy()
    descriptor[0, 0, 0] = value
    _arrays(path, descriptor=descriptor)


BAD_DESCRIPTORS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: path.unlink(), "no such file"),
    "truncated": (_truncated, "expected a descriptor file"),
    "no archive": (lambda path: path.write_text("hello"), "expected a descriptor file"),
    "NaN": (lambda path: _value(path, np.nan), "must be finite, got NaN or Inf"),
    "Inf": (lambda path: _value(path, -np.inf), "must be finite, got NaN or Inf"),
    "too large for float32": (lambda path: _arrays(path, descriptor=np.full((5, 6, 31), 1e300)), "fit float32"),
    "another spec": (lambda path: _arrays(path, spec=np.array(presets.paper().to_json())), "a paper descriptor of"),
    "another shape": (lambda path: _arrays(path, descriptor=np.zeros((6, 5, 31), np.float32)), "got (6, 5, 31)"),
    "another length": (lambda path: _arrays(path, descriptor=np.zeros((5, 6, 32), np.float32)), "got (5, 6, 32)"),
    "pickled": (lambda path: _arrays(path, spec=np.array([{}], dtype=object)), "pickled objects, which are never"),
}


@pytest.mark.parametrize("command", ["glyph", "invert"])
@pytest.mark.parametrize("what", BAD_DESCRIPTORS)
def test_bad_descriptor_files(
    tmp_path: Path, descriptor: str, refused: Callable[..., None], command: str, what: str
) -> None:
    make, message = BAD_DESCRIPTORS[what]
    make(Path(descriptor))
    refused(command, descriptor, "-o", str(tmp_path / "out"), message=f"{descriptor}: ")
    refused(command, descriptor, "-o", str(tmp_path / "out"), message=message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--descriptor", "paper"], "another spec than asked for: its name is 'uoctti', not 'paper'"),
        (["--cell", "8x4"], "its cell_size is (8, 8), not (8, 4)"),
        (["--vote", "hard"], "its vote is 'linear', not 'hard'"),
    ],
)
def test_descriptor_files_of_another_spec_than_asked_for(
    tmp_path: Path, descriptor: str, refused: Callable[..., None], options: list[str], message: str
) -> None:
    refused("invert", descriptor, "-o", str(tmp_path / "out"), *options, message=message)


def test_a_spec_of_the_same_name_is_not_the_same_spec(tmp_path: Path, refused: Callable[..., None]) -> None:
    spec = presets.paper(bins=6)
    save_descriptor(tmp_path / "d.npz", torch.rand(2, 2, 6), spec, (16, 16))
    options = ["-o", str(tmp_path / "out"), "--descriptor", "paper"]
    refused("glyph", str(tmp_path / "d.npz"), *options, message="its bins is 6, not 9")


def test_descriptor_files_of_the_spec_asked_for(tmp_path: Path, descriptor: str) -> None:
    options = ["--descriptor", "uoctti", "--cell", "8", "--vote", "linear"]
    assert main(["glyph", descriptor, "-o", str(tmp_path / "out"), *options]) == 0


@pytest.mark.parametrize("command", ["hog", "glyph", "invert"])
def test_output_folders_that_cannot_be(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setattr(invert, "invert_batch", None)  # it must fail before any work
    for path in (f"{photo}/out", f"{photo}/below/out"):
        refused(command, photo, photo, "-o", path, message="is not a folder")
    refused(command, photo, photo, "-o", "/proc/nablahog/out", message="the output folder /proc/nablahog/out cannot be")


@pytest.mark.parametrize(
    "argv",
    [
        *(["hog", "a.png"], ["glyph", "a.png"], ["invert", "a.png"], ["invert-template", "a.npy"], ["demo"]),
        *(["table1"], ["table2"], ["pose", "a.png"]),
        *(["learn", "prior"], ["learn", "bovw"], ["learn", "exemplars", "--models", "."]),
    ],
    ids=" ".join,
)
def test_an_output_without_a_name(refused: Callable[..., None], argv: list[str]) -> None:
    refused(*argv, "-o", "", message="argument -o/--output: expected the name of a file or folder, got ''", status=2)


def test_other_files_without_a_name(refused: Callable[..., None]) -> None:
    for argv in (
        ["hog", "", "-o", "x"],
        ["table1", "-o", "x", "--images", ""],
        ["invert", "a", "-o", "x", "--prior", ""],
    ):
        refused(*argv, message="expected the name of a file or folder, got ''", status=2)


@pytest.mark.parametrize("name", ["a.png", "a.npz", "a.npy", "a.mat", "a"])
def test_pipes(tmp_path: Path, refused: Callable[..., None], name: str) -> None:
    os.mkfifo(tmp_path / name)
    refused("glyph", str(tmp_path / name), "-o", str(tmp_path / "out"), message="got a special file")


def test_errors_are_one_short_printable_line(
    tmp_path: Path, descriptor: str, refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    fields = json.loads(presets.uoctti().to_json())
    _arrays(Path(descriptor), spec=np.array(json.dumps(fields | {"border": "\x1b[31m" * 20_000})))
    argv = ["glyph", descriptor, "-o", str(tmp_path / "out")]
    refused(*argv, message="border must be one of")
    for wrong in (argv, ["glyph", "a\x1b[31m\u202eb", *argv[2:]], [*argv, "--key", "x" * 5000, "--\x1b[31m"]):
        main(wrong)
        printed = capsys.readouterr().err
        assert len(printed) <= 1001
        assert printed.removesuffix("\n").isprintable()


def test_few_bytes_that_ask_for_much_memory(tmp_path: Path, refused: Callable[..., None]) -> None:
    small, wide, out = str(tmp_path / "small.npz"), str(tmp_path / "wide.npz"), ["-o", str(tmp_path / "out")]
    save_descriptor(small, torch.rand(1, 1, 31), presets.uoctti(6000), (6000, 6000))
    assert Path(small).stat().st_size < 4096
    message = (
        f"{small}: inverting a descriptor of an image of 6000x6000 pixels needs about 12 GB of memory, and 4 GB are"
    )
    refused("invert", small, *out, message=message)
    refused("invert", small, *out, "--memory", "11", message="11 GB are allowed: expected --memory 12 where")
    save_descriptor(wide, torch.rand(1, 1, 31), presets.uoctti((1, 10**6)), (1, 10**6))
    for command, needed in (("glyph", 396), ("invert", 394)):
        message = f"drawing 1x1 cells, each for 1x1000000 pixels, needs about {needed} GB"
        refused(command, wide, *out, message=message)
    np.save(tmp_path / "t.npy", np.ones((1, 1, 31), np.float32))
    options = ["--preset", "uoctti", "--cell", "6000", "--image-size", "6000x6000", *out]
    refused("invert-template", str(tmp_path / "t.npy"), *options, message="needs about 12 GB of memory")


def test_demo_needs_its_folder(photo: str, refused: Callable[..., None]) -> None:
    refused("demo", "-o", f"{photo}/out", message="is not a folder")


def test_inputs_are_not_overwritten(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    refused("hog", photo, "-o", photo, message="would overwrite an input")
    beside = tmp_path / "in" / "cat_preimage.png"
    Image.fromarray(CHELSEA).save(beside)
    refused("invert", photo, str(beside), "-o", str(tmp_path / "in"), *FAST, message="would overwrite an input")


def test_one_file_for_several_inputs(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    for command, name in [("hog", "d.npz"), ("glyph", "g.png")]:
        refused(command, photo, photo, "-o", str(tmp_path / name), message="several inputs need a folder")
    refused("glyph", photo, "-o", str(tmp_path / "g.jpg"), message="glyphs are written as PNG")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cell", "0"], "one number or HEIGHTxWIDTH, each at least 1, got '0'"),
        (["--cell", "8x"], "got '8x'"),
        (["--size", "-1"], "expected an integer of at least 0, got '-1'"),
        (["--seed", "many"], "got 'many'"),
        (["--device", "tpu"], "expected cpu, cuda or cuda:N, got 'tpu'"),
        (["--descriptor", "sift"], "invalid choice: 'sift'"),
        (["--preset", "sikmage"], "did you mean 'skimage'?"),
        (["--quality", "Fats"], "did you mean 'fast'?"),
        (["--qualty", "fast"], "unrecognized arguments: --qualty fast; did you mean '--quality'?"),
        (["-o", "-"], "these results cannot go to stdout"),
        (["--max-evaluations", "1"], "at least 2, got '1'"),
    ],
)
def test_bad_options(
    tmp_path: Path, photo: str, refused: Callable[..., None], options: list[str], message: str
) -> None:
    refused("invert", photo, "-o", str(tmp_path / "out"), *options, message=message, status=2)


def test_the_papers_votes_are_linear(tmp_path: Path, photo: str, refused: Callable[..., None]) -> None:
    options = ["--descriptor", "paper", "--vote", "hard"]
    refused("hog", photo, "-o", str(tmp_path / "d"), *options, message="the paper descriptor has linear votes")


def test_cuda_asked_for_and_absent(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for command in ("hog", "glyph", "invert"):
        options = ["-o", str(tmp_path / "out"), "--device", "cuda"]
        refused(command, photo, *options, message="expected a CUDA device for cuda", status=2)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    refused("hog", photo, "-o", str(tmp_path / "o"), "--device", "cuda:1", message="cuda:0 … cuda:0", status=2)
