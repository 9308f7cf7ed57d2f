"""Commands that are killed at any time and started again: the results of one that was never disturbed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import torch
from hypothesis import strategies as st
from PIL import Image

from nablahog.cli.commands import hog, learn, tables  # noqa: F401, loaded once
from nablahog.cli.main import main
from nablahog.hog.kernels import loops  # noqa: F401, loaded once
from nablahog.io.descriptor_dataset import DescriptorDataset

from .harness import examine, parts

WORKERS_END = 2.0  # seconds after their parent
VARYING = {"index.html", "times.csv", "work"}  # hold seconds
TABLE1 = ["--images", "images", "--methods", "dalal-single", "--max-evaluations", "60", "--size", "32"]
TABLE2 = ["--objects", "3", "--methods", "exhaustive", "--conditions", "none"]
COMMANDS: dict[str, list[str]] = {
    "hog": ["hog", *(f"images/{k}.png" for k in range(6)), "-o", "out/"],
    "dataset": ["hog", *([f"images/{k}.png" for k in range(6)] * 100), "-o", "out.parquet", "--workers", "1"],
    "prior": ["learn", "prior", "--images", "images", "-o", "out/model.npz", "--epochs", "2"],
    "table1": ["table1", *TABLE1, "--workers", "1", "-o", "out"],
    "table2": ["table2", *TABLE2, "--workers", "2", "-o", "out"],
}
moments = st.lists(st.floats(0, 1.1, allow_nan=False), min_size=1, max_size=3)
cases = st.tuples(st.sampled_from(sorted(COMMANDS)), moments)
pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
# a process that forks, so that PyTorch is loaded once
forking = multiprocessing.get_context("forkserver")
forking.set_forkserver_preload([__name__])


def run(folder: Path, command: Sequence[str]) -> None:
    """A command in a folder, in a process of its own."""
    os.chdir(folder)
    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # processes in the background may ignore it
    output = os.open("printed", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    status = 99
    try:
        status = main(command)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)


@cache
def home() -> TemporaryDirectory[str]:
    """A folder with photographs, removed at the end of this process."""
    folder = TemporaryDirectory(prefix="nablahog-kills-")
    images = Path(folder.name, "images")
    images.mkdir()
    rng = np.random.default_rng(0)
    for k in range(6):
        small = Image.fromarray(rng.integers(0, 256, (8, 9, 3), dtype=np.uint8))
        small.resize((48, 40), Image.Resampling.BICUBIC).save(images / f"{k}.png")
    return folder


def new_folder() -> Path:
    """An empty folder to run a command in."""
    folder = Path(home().name, str(len(os.listdir(home().name))))
    folder.mkdir()
    (folder / "images").symlink_to(Path(home().name, "images"))
    return folder


def finish(folder: Path, command: str) -> float:
    """Runs a command to its end; returns the seconds."""
    began, process = time.monotonic(), forking.Process(target=run, args=(folder, COMMANDS[command]))
    process.start()
    process.join()
    assert process.exitcode == 0, (folder / "printed").read_text()[-500:]
    return time.monotonic() - began


def results(folder: Path) -> dict[str, bytes]:
    """The contents of the files in the output folder, by name, without seconds: the last column of objects."""
    (out,) = folder.glob("out*")
    files = {path.name: path.read_bytes() for path in out.iterdir() if path.name not in VARYING}
    if "per_object.csv" in files:
        files["per_object.csv"] = b"\n".join(line.rpartition(b",")[0] for line in files["per_object.csv"].splitlines())
    return files


@cache
def undisturbed(command: str) -> tuple[float, dict[str, bytes]]:
    """Seconds and results of a run that nothing disturbs."""
    folder = new_folder()
    return finish(folder, command), results(folder)


def check(case: tuple[str, list[float]]) -> str:
    """Runs a command, kills it once or several times, at shares of its time, and runs it to its end."""
    command, (seconds, expected) = case[0], undisturbed(case[0])
    folder = new_folder()
    for moment in case[1]:
        process = forking.Process(target=run, args=(folder, COMMANDS[command]))
        process.start()
        process.join(moment * seconds)
        end(process, signal.SIGKILL)
    abandon_parts(folder)
    finish(folder, command)
    assert results(folder) == expected
    assert not [path.name for path in folder.rglob("*") if path.suffix in (".part", ".checkpoint", ".damaged")]
    return command


def abandon_parts(folder: Path) -> None:
    """Makes half-written files old: a young one is of another process as far as anybody knows, which may write it."""
    for part in folder.rglob("*.part"):
        os.utime(part, (0, 0))


def end(process: BaseProcess, by: signal.Signals) -> None:
    """Ends a command by a signal; its workers end, too."""
    workers = children(process.pid)
    with suppress(ProcessLookupError):
        os.kill(process.pid or 0, by)
    process.join()
    latest = time.monotonic() + WORKERS_END
    while any(map(running, workers)):
        assert time.monotonic() < latest, "workers live on"
        time.sleep(0.01)


def times(folder: Path, parts_of_it: str) -> dict[str, int]:
    """When each part that is done was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob(parts_of_it)}


def children(process: int | None) -> list[int]:
    try:
        return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


def running(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("case", [("hog", [0.3, 0.8]), ("prior", [0.7])])
def test_killed_commands(case: tuple[str, list[float]]) -> None:
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "parts_of_it", "count"),
    [("table1", "out/work/*/*.npz", 6), ("dataset", "out.parquet/part-*.parquet", 600)],
)
def test_interrupted_and_then_killed(command: str, parts_of_it: str, count: int) -> None:
    """Once some parts are done: nothing is done twice, and in the end the results are those of an undisturbed run."""
    folder, done = new_folder(), dict[str, int]()
    for by, status in ((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)):
        process = forking.Process(target=run, args=(folder, COMMANDS[command]))
        process.start()
        while len(times(folder, parts_of_it)) == len(done) and process.is_alive():
            time.sleep(0.001)
        end(process, by)
        assert process.exitcode == status
        if by == signal.SIGINT:
            assert ": error: interrupted" in (folder / "printed").read_text().splitlines()[-1]
            assert not list(folder.rglob("*.part"))
        assert done.items() < times(folder, parts_of_it).items()
        done = times(folder, parts_of_it)
        assert len(done) < count
        if command == "table1":
            assert os.listdir(folder / "out") == ["work"]
        else:
            with pytest.raises(ValueError, match="of 600 images are not there"):
                DescriptorDataset(str(folder / "out.parquet"))
    abandon_parts(folder)
    finish(folder, command)
    assert done.items() < times(folder, parts_of_it).items()
    assert results(folder) == undisturbed(command)[1]


@pytest.mark.xslow
@parts
def test_random_kills(part: int) -> None:
    examine(check, cases, 4, part)
