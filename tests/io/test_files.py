"""Nothing is ever half-written."""

from __future__ import annotations

import ast
import errno
import io
import itertools
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from nablahog.io.arrays import write_arrays
from nablahog.io.files import (
    ABANDONED,
    checkpoint_for,
    distinct_stems,
    natural_order,
    output_folder,
    remove_parts,
    replacing,
)


def test_replacing(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["file"]
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def fail() -> None:
        with replacing(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that Python closes itself
def test_an_interrupt_at_any_moment(tmp_path: Path) -> None:
    """Between any two instructions of the function and of what it calls in Python."""
    (tmp_path / "file").write_text("old")
    remaining = 0

    def trace(frame: FrameType, event: str, _: object) -> Callable[..., object]:
        nonlocal remaining
        frame.f_trace_opcodes = True
        remaining -= event == "opcode"
        if not remaining:
            raise KeyboardInterrupt
        return trace

    def write() -> None:
        with replacing(tmp_path / "file") as file:
            file.write(b"new")

    before = sys.gettrace()
    for moment in itertools.count(1):
        remaining = moment
        with suppress(KeyboardInterrupt):
            sys.settrace(trace)
            try:
                write()
            finally:
                sys.settrace(before)
        assert os.listdir(tmp_path) == ["file"]
        if remaining > 0:
            break
    assert moment > 100
    assert (tmp_path / "file").read_text() == "new"


def test_what_a_killed_process_left(tmp_path: Path) -> None:
    old, stalled = tmp_path / ".nablahog-1.part", tmp_path / ".nablahog-2.part"
    for part, age in ((old, ABANDONED + 3600), (stalled, ABANDONED - 3600)):
        part.touch()
        os.utime(part, (time.time() - age,) * 2)
    with replacing(tmp_path / "file") as file:
        remove_parts(tmp_path)
        assert len(os.listdir(tmp_path)) == 2  # of this process, and of one that may still write
        file.write(b"new")
    assert sorted(os.listdir(tmp_path)) == [stalled.name, "file"]
    remove_parts(tmp_path / "missing")
    os.utime(stalled, (0, 0))
    with output_folder(tmp_path):
        assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("largest", [0, 5000])
def test_a_full_disk(tmp_path: Path, largest: int) -> None:
    """The error names the file, not the temporary one, and nothing is left."""
    resource = pytest.importorskip("resource")
    path = tmp_path / "file"
    path.write_text("old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            write_arrays(path, 1, {"x": np.random.default_rng(0).random(10_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(caught.value) == f"[Errno {errno.EFBIG}] File too large: '{path}'"
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_checkpoint_stays_until_the_work_is_done(tmp_path: Path) -> None:
    output = tmp_path / "x.npz"

    def interrupted() -> None:
        with checkpoint_for(output) as checkpoint:
            checkpoint.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert os.listdir(tmp_path) == ["x.npz.checkpoint"]
    (tmp_path / ".nablahog-1-0.part").touch()
    os.utime(tmp_path / ".nablahog-1-0.part", (0, 0))
    with checkpoint_for(output) as checkpoint:
        assert checkpoint.read_text() == "half"
        assert os.listdir(tmp_path) == ["x.npz.checkpoint"]
        output.touch()
    assert os.listdir(tmp_path) == ["x.npz"]
    with checkpoint_for(output):  # work that needs none
        pass


def test_links_and_special_files(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("target")
    with replacing(tmp_path / "link") as file:
        file.write(b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"
    os.mkfifo(tmp_path / "pipe")
    for special in ("pipe", "."):
        with pytest.raises(FileExistsError, match="regular file"), replacing(tmp_path / special):
            pass


@pytest.mark.parametrize("path", [3, io.StringIO()])
def test_what_is_no_file_to_write(path: Any) -> None:
    with pytest.raises(TypeError, match="must be a path or a binary stream, got"), replacing(path):
        pass


def test_a_failure_removes_only_what_was_made_and_is_empty(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()

    def fail(*files: str) -> None:
        with output_folder(tmp_path / "a" / "b" / "c") as folder:
            for file in files:
                (folder / file).touch()
            raise ValueError("oh")

    with pytest.raises(ValueError, match="oh"):
        fail()
    assert os.listdir(tmp_path) == ["a"]
    assert not os.listdir(tmp_path / "a")
    with pytest.raises(ValueError, match="oh"):
        fail("kept")
    assert (tmp_path / "a" / "b" / "c" / "kept").exists()


def test_folders_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "dangling").symlink_to("nowhere")
    for path in ("file", "file/below", "file/further/below", "dangling", "dangling/below"):
        with pytest.raises(NotADirectoryError, match="is not a folder"), output_folder(tmp_path / path):
            pass
    with pytest.raises(PermissionError, match="cannot be written"), output_folder("/proc/nablahog"):
        pass
    assert sorted(os.listdir(tmp_path)) == ["dangling", "file"]


def test_distinct_stems() -> None:
    def stems(*paths: str) -> list[str]:
        return distinct_stems([Path(path) for path in paths])

    assert stems("x/a.png", "y/b.jpg") == ["a", "b"]
    first, second, third = stems("x/a.png", "y/a.jpg", "a")
    assert stems("./x//a.png", os.path.abspath("a"), "b.png") == [first, third, "b"]  # the second is gone
    assert all(re.fullmatch("a_[0-9a-f]{8}", stem) for stem in {first, second, third})
    assert len({first, second, third}) == 3
    small, capital = stems("a.png", "A.png")
    assert (small[:2], capital[:2]) == ("a_", "A_")
    assert stems("a.png", "./a.png", "a_2.png") == ["a", "a_3", "a_2"]
    assert [len(stem.encode()) for stem in stems("é" * 200 + ".png", "a" + "é" * 200)] == [180, 179]
    code = "import nablahog.io.files as f, pathlib, sys; print(ascii(f.distinct_stems([pathlib.Path(sys.argv[1])])))"
    of_c = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    told = subprocess.run(
        [sys.executable, "-c", code, "naïve.png"], env=of_c, capture_output=True, text=True, check=True
    )
    assert os.fsencode(ast.literal_eval(told.stdout)[0]) == "naïve".encode()


def test_natural_order() -> None:
    names = ["10.png", "2.png", "b1", "a10", "a9", "1.png", "a9b2", "a9b10"]
    assert sorted(names, key=natural_order) == ["1.png", "2.png", "10.png", "a9", "a9b2", "a9b10", "a10", "b1"]
