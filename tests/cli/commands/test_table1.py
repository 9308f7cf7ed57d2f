"""`nablahog table1` as people use, misuse, interrupt and kill it."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli.main import main

from ..common import CHELSEA, names

TABLES = ["failures.csv", "index.html", "per_image.csv", "summary.csv", "times.csv"]
SAME = ["failures.csv", "per_image.csv", "summary.csv"]
QUICK = ["--methods", "dalal-multi-scale,dalal-single", "--max-evaluations", "60", "--size", "32", "--workers", "1"]
ITEMS = 10


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Five small photographs and a file that is none."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(5):
        Image.fromarray(CHELSEA[4 * k : 4 * k + 32, 8 * k : 8 * k + 32]).save(folder / f"{k}.png")
    (folder / "x.png").write_bytes(b"no image")
    return str(folder)


def _tables(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in SAME}


def test_the_command(tmp_path: Path, images: str, here: None, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["table1", "--images", images, "-o", str(out), *QUICK, "--max-evaluations", "3", "--limit", "6"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in ("dalal-single", "hoggles", "0.170", "Ran: ", f"Look at {out / 'index.html'}"):
        assert text in printed.out
    assert printed.out.index("dalal-multi-scale ") < printed.out.index("\n  @1/64 ")
    assert "Failed: x.png, all methods: expected an image" in printed.out
    assert names(out) == [*TABLES, "work"]
    html = (out / "index.html").read_text()
    for text in ("6 images of the folder images.", "x.png", "Pearson correlation"):
        assert text in html
    with open(out / "per_image.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows[:6]] == ["dalal-single"] * 5 + ["dalal-multi-scale"]  # in the table's order


def test_what_it_refuses(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes.txt").touch()
    to = ["table1", "-o", str(tmp_path / "out")]
    refused(*to, "--methods", "dalal-single,hog", message="expected methods of bovw, hoggles, cnn-hog", status=2)
    refused(*to, "--learned", "prior", message="expected KIND=FILE", status=2)
    refused(*to, "--images", str(tmp_path / "empty"), message="expected a folder of images, but it holds none")
    refused(*to, "--images", images, "--learned", f"prior={images}/no", message="no such file")
    options = ["--learned", f"prior={images}/0.png", "--methods", "dalal-single"]
    refused(*to, "--images", images, *options, message="these do: uoctti-learned")


def test_no_result_at_all(tmp_path: Path, images: str, here: None, refused: Callable[..., None]) -> None:
    for name in os.listdir(images):
        Path(images, name).write_bytes(b"no image")
    message = "there is no result for any image; the first: 0.png: expected an image"
    refused("table1", "--images", images, "-o", str(tmp_path / "out"), *QUICK, message=message)


@contextmanager
def _started(images: str, out: Path) -> Iterator[subprocess.Popen[str]]:
    """The command in a process group of its own, as a terminal starts it, once a result was stored since."""
    before = _stored(out)
    # a test run in the background may have told its children to ignore interrupts
    program = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); " + (
        "from nablahog.cli.main import main; sys.exit(main())"
    )
    command = [sys.executable, "-c", program, "table1", "--images", images, "-o", str(out), *QUICK]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        try:
            while _stored(out) == before and process.poll() is None:
                time.sleep(0.005)
            yield process
        finally:
            process.kill()


def _stored(out: Path) -> dict[str, int]:
    """Stored results, with the times they were written."""
    return {str(path): path.stat().st_mtime_ns for path in out.glob("work/*/*.npz")}


def _children(process: subprocess.Popen[str]) -> list[int]:
    return [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]


def _running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def _gone(pids: Sequence[int]) -> bool:
    deadline = time.monotonic() + 20
    while any(_running(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(_running(pid) for pid in pids)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_interrupted_killed_and_repeated(tmp_path: Path, images: str, here: None) -> None:
    """Ctrl-C, `kill -9`, and a third run that ends: the tables of a run that was never disturbed."""
    out, undisturbed = tmp_path / "out", tmp_path / "undisturbed"
    with _started(images, out) as process:
        children = _children(process)
        os.killpg(process.pid, signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    assert (process.returncode, error) == (130, "nablahog table1: error: interrupted\n")
    assert len(children) >= 1
    assert _gone(children)
    interrupted = _stored(out)
    assert 0 < len(interrupted) < ITEMS

    with _started(images, out) as process:
        children = _children(process)
        process.kill()
        process.wait()
    assert _gone(children)
    killed = _stored(out)
    assert len(interrupted) < len(killed) < ITEMS
    assert names(out) == ["work"]

    assert main(["table1", "--images", images, "-o", str(out), *QUICK]) == 0
    finished = _stored(out)
    assert len(finished) == ITEMS
    assert killed.items() <= finished.items()  # nothing was done twice
    assert interrupted.items() <= killed.items()
    assert main(["table1", "--images", images, "-o", str(undisturbed), *QUICK]) == 0
    assert _tables(out) == _tables(undisturbed)
