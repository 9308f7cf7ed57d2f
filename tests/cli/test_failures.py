"""Work that fails half-way, the command as a process, and names of files with letters that the locale lacks."""

from __future__ import annotations

import csv
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from nablahog.cli.commands import invert
from nablahog.cli.main import main
from nablahog.cli.results import inversion
from nablahog.io.descriptor_dataset import DescriptorDataset

from .common import CHELSEA, FAST, WEDGE, names


def test_work_that_fails(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    for error, status, message in (
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "not enough memory"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), 1, "not enough memory"),
        (ValueError("the descriptor\nmust not be zero"), 1, "cat.png: the descriptor must not be zero"),
    ):
        monkeypatch.setattr(inversion, "reconstruct", Mock(side_effect=error))
        refused("invert", photo, "-o", str(tmp_path / "out"), message=message, status=status)
    monkeypatch.setattr(inversion, "reconstruct", Mock(side_effect=RuntimeError("shapes differ")))
    with pytest.raises(RuntimeError, match="shapes differ"):  # a bug is not hidden
        main(["invert", photo, "-o", str(tmp_path / "out")])


INTERRUPTED_IMPORT = """import os, signal, sys
from nablahog.__main__ import main
class Finder:  # an import in which KeyboardInterrupt is lost, as in NumPy's __getattr__
    def find_spec(name, path, target=None):
        if name == "numpy":
            try:
                os.kill(os.getpid(), signal.SIGINT)
                for _ in range(1000):
                    pass
            except KeyboardInterrupt:
                raise RecursionError
sys.meta_path.insert(0, Finder)
signal.signal(signal.SIGINT, signal.default_int_handler)  # programs in the background are started without
sys.argv = ["nablahog", "hog", "cat.png", "-o", "cat.npz"]
sys.exit(main())"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="a process cannot send itself Ctrl-C there")
def test_ctrl_c_in_an_import_ends_the_command() -> None:
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED_IMPORT], capture_output=True, text=True, timeout=120)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "nablahog: error: interrupted\n")


def test_what_is_finished_survives(tmp_path: Path, photo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.fromarray(CHELSEA[:, :48]).save(tmp_path / "in" / "second.png")
    real, calls = invert.invert_batch, []

    def second_fails(*args: Any, **options: Any) -> Any:
        calls.append(args)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*args, **options)

    monkeypatch.setattr(invert, "invert_batch", second_fails)
    assert main(["invert", photo, str(tmp_path / "in" / "second.png"), "-o", str(tmp_path / "out"), *FAST]) == 130
    assert names(tmp_path / "out") == ["cat_glyphs.png", "cat_preimage.png", "cat_thumbnails.png", "results.json"]
    assert len(json.loads((tmp_path / "out" / "results.json").read_text())) == 1


@pytest.mark.slow
def test_names_that_the_terminal_cannot_show(tmp_path: Path, photo: str) -> None:
    odd = tmp_path / "in" / "[red] é\n.png"
    os.rename(photo, odd)
    command = [sys.executable, "-m", "nablahog", "hog", str(odd), f"{odd}x", "-o", str(tmp_path / "d")]
    run = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONIOENCODING": "ascii"}, check=False
    )
    assert run.returncode == 3
    assert "[red]" in run.stdout
    assert run.stderr.count("\n") == 1
    assert "Traceback" not in run.stderr


@pytest.mark.slow
def test_without_standard_output_the_work_is_done(tmp_path: Path) -> None:
    Image.new("L", (32, 32), 9).save(tmp_path / "a.png")
    command = f"{sys.executable} -m nablahog hog {tmp_path}/a.png -o {tmp_path}/a.npz >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], timeout=300).returncode == 0
    assert (tmp_path / "a.npz").stat().st_size > 0


def test_a_reader_that_has_closed_the_pipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    Image.new("L", (32, 32), 9).save(tmp_path / "a.png")
    with os.fdopen(writer, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        assert main(["hog", str(tmp_path / "a.png"), "-o", "-"]) == 1


def test_bytes_are_not_written_to_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("L", (32, 32), 9).save(tmp_path / "a.png")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    for command in ("hog", "glyph"):
        assert main([command, str(tmp_path / "a.png"), "-o", "-"]) == 1
        assert "stdout is a terminal: expected a pipe" in capsys.readouterr().err


def test_bytes_are_not_written_to_a_closed_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("L", (32, 32), 9).save(tmp_path / "a.png")
    with open(os.devnull, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        for command in ("hog", "glyph"):
            assert main([command, str(tmp_path / "a.png"), "-o", "-"]) == 1
            assert "stdout, which is closed: expected a pipe" in capsys.readouterr().err


def test_what_the_package_logs_is_shown_in_a_terminal(
    photo: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package = logging.getLogger("nablahog")
    monkeypatch.setattr(package, "handlers", [])
    monkeypatch.setattr(package, "level", logging.NOTSET)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for _ in range(2):
        assert main(["hog", photo, "-o", str(tmp_path / "a.npz")]) == 0
    capsys.readouterr()
    logger = logging.getLogger("nablahog.jobs.cluster")
    logger.info("the dashboard: %s", "a\nb")
    logger.debug("no")
    assert capsys.readouterr().err == "nablahog: the dashboard: a b\n"


IN_C = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
NAME = "stühle [1].png"


def _run(folder: Path, *words: str) -> str:
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=folder, env=IN_C, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(tmp_path / NAME)
    return tmp_path


@pytest.mark.slow
def test_a_data_set_and_its_images(folder: Path) -> None:
    (folder / "list.txt").write_text(f"{NAME}\n", "utf-8")
    _run(folder, "-m", "nablahog", "hog", NAME, "@list.txt", "-o", "ü.parquet", "--workers", "1", "--quiet")
    assert [(row.path, row.error) for row in DescriptorDataset(str(folder / "ü.parquet"))] == [(NAME, None)] * 2
    _run(folder, "-m", "nablahog", "invert", "ü.parquet", "-o", "out", "--quality", "fast", "--quiet")
    assert "000000_stühle [1]_preimage.png" in os.listdir(folder / "out")


@pytest.mark.slow
def test_poses(folder: Path) -> None:
    (folder / "wedge_ü.off").write_text(WEDGE)
    (folder / "list.csv").write_text(f"image,x0,y0,x1,y1\n{NAME},5,5,60,60\n", "utf-8")
    options = ["--mesh", "wedge_ü.off", "--annotations", "list.csv", "--method", "paper", "--least-confidence", "0"]
    _run(folder, "-m", "nablahog", "pose", ".", *options, "-o", "out", "--quiet")
    with open(folder / "out" / "poses.csv", encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["image"], row["model"], row["error"]) == (NAME, "wedge_ü", "")


@pytest.mark.slow
def test_a_texture(folder: Path) -> None:
    Image.fromarray(np.full((8, 8), 51, np.uint8)).save(folder / NAME)
    (folder / "ü.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {NAME}\n", "utf-8")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .5 .5\n"
    (folder / "a.obj").write_text(f"mtllib ü.mtl\n{corners}usemtl m\nf 1/1 2/1 3/1\n", "utf-8")
    code = "from nablahog.render import load_mesh; print(load_mesh('a.obj').brightness.tolist())"
    assert _run(folder, "-c", code).split() == ["[0.2,", "0.2,", "0.2]"]
