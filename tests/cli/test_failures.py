"""Work that fails half-way, and the command as a process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from nablahog.cli.commands import invert
from nablahog.cli.main import main
from nablahog.cli.results import inversion

from .common import CHELSEA, FAST, names


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "not enough memory"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), 1, "not enough memory"),
        (ValueError("the descriptor\nmust not be zero"), 1, "cat.png: the descriptor must not be zero"),
    ],
)
def test_work_that_fails(
    tmp_path: Path,
    photo: str,
    refused: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
    message: str,
) -> None:
    def fail(*args: object, **options: object) -> None:
        raise error

    monkeypatch.setattr(inversion, "reconstruct", fail)
    refused("invert", photo, "-o", str(tmp_path / "out"), message=message, status=status)


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


def test_a_bug_is_not_hidden(tmp_path: Path, photo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: object, **options: object) -> None:
        raise RuntimeError("shapes differ")

    monkeypatch.setattr(inversion, "reconstruct", fail)
    with pytest.raises(RuntimeError, match="shapes differ"):
        main(["invert", photo, "-o", str(tmp_path / "out")])


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


def test_without_standard_output_the_work_is_done(tmp_path: Path) -> None:
    Image.new("L", (32, 32), 9).save(tmp_path / "a.png")
    command = f"{sys.executable} -m nablahog hog {tmp_path}/a.png -o {tmp_path}/a.npz >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], timeout=300).returncode == 0
    assert (tmp_path / "a.npz").stat().st_size > 0
