"""Commands that are killed at any time and started again: the results of one that was never disturbed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import strategies
from PIL import Image

from .harness import Fault

LIMIT = 120.0  # seconds of one run
WORKERS_END = 2.0  # seconds after their parent
VARYING = {"index.html", "times.csv", "work"}  # hold seconds
QUICK = ["--methods", "dalal-multi-scale,dalal-single", "--max-evaluations", "40", "--size", "32"]
LEARN = ["--images", "images", "--cell", "4", "-o", "out/model.npz"]
COMMANDS: dict[str, list[str]] = {
    "hog": ["hog", *(f"images/{k}.png" for k in range(6)), "-o", "out/"],
    "prior": ["learn", "prior", "--images", "images", "-o", "out/model.npz", "--epochs", "2", "--threads", "1"],
    "hoggles": ["learn", "hoggles", *LEARN],
    "table1": ["table1", "--images", "images", *QUICK, "--workers", "1", "-o", "out"],
    "table2": ["table2", "--objects", "3", "--methods", "paper", "--workers", "1", "-o", "out"],
    "workers": ["table1", "--images", "images", *QUICK, "--workers", "2", "-o", "out"],
}


@dataclass(frozen=True)
class Case:
    """A command that is killed.

    Attributes:
        command: of :data:`COMMANDS`.
        moments: of each run but the last, when it is killed, as shares of the time of an undisturbed one.
    """

    command: str
    moments: tuple[float, ...]


_moment = strategies.floats(0, 1.1, allow_nan=False)
cases = strategies.builds(
    Case, strategies.sampled_from(sorted(COMMANDS)), strategies.lists(_moment, min_size=1, max_size=3).map(tuple)
)


class _Commands:
    """The process that runs commands, in a folder with photographs."""

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory(prefix="nablahog-kills-")
        (self.path / "images").mkdir()
        rng = np.random.default_rng(0)
        for k in range(6):
            small = Image.fromarray(rng.integers(0, 256, (8, 9, 3), dtype=np.uint8))
            small.resize((48, 40), Image.Resampling.BICUBIC).save(self.path / "images" / f"{k}.png")
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from tests.fuzz.command_server import serve; serve()"],
            cwd=Path(__file__).parents[2],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.runs = 0

    @property
    def path(self) -> Path:
        return Path(self.folder.name)

    def new(self) -> Path:
        """An empty folder to run a command in."""
        self.runs += 1
        made = self.path / str(self.runs)
        made.mkdir()
        (made / "images").symlink_to(self.path / "images")
        return made

    def start(self, folder: Path, command: Sequence[str]) -> int:
        """Starts a command.  Returns the number of its process."""
        assert self.process.stdin is not None
        self.process.stdin.write("\t".join([str(folder), *command]) + "\n")
        self.process.stdin.flush()
        return int(self._line())

    def status(self) -> int:
        """The exit status of the command that was started, at its end."""
        return int(self._line())

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.folder.cleanup()


@cache
def _commands() -> _Commands:
    return _Commands()


def close() -> None:
    """Ends the process and removes its folder."""
    if _commands.cache_info().currsize:
        _commands().close()
        _commands.cache_clear()
        _undisturbed.cache_clear()


@cache
def _undisturbed(command: str) -> tuple[float, dict[str, bytes]]:
    """Seconds and results of a run that nothing disturbs: the second one, which finds all files in memory."""
    for _ in range(2):
        folder = _commands().new()
        began = time.monotonic()
        _finish(folder, command)
        seconds = time.monotonic() - began
    return seconds, _results(folder)


def _finish(folder: Path, command: str) -> None:
    _commands().start(folder, COMMANDS[command])
    status = _commands().status()
    if status:
        raise Fault("crashed", f"exit status {status}: {(folder / 'printed').read_text()[-500:]}")


def _results(folder: Path) -> dict[str, bytes]:
    """The contents of the files in the output folder, by name, that do not hold seconds."""
    paths = [path for path in (folder / "out").iterdir() if path.name not in VARYING]
    return {path.name: _without_seconds(path) for path in paths}


def _without_seconds(path: Path) -> bytes:
    data = path.read_bytes()
    if path.name != "per_object.csv":
        return data
    return b"\n".join(line.rpartition(b",")[0] for line in data.split(b"\n"))  # the last column


def check(case: Case) -> str:
    """Runs a command, kills it once or several times, and runs it to its end.

    Returns:
        How many kills came before the end of the command.

    Raises:
        Fault: a worker lives on, the last run fails, its results differ, or temporary files are left.
    """
    seconds, expected = _undisturbed(case.command)
    folder, kills = _commands().new(), 0
    for moment in case.moments:
        process = _commands().start(folder, COMMANDS[case.command])
        time.sleep(moment * seconds)
        workers = _children(process)
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
        kills += _commands().status() == -signal.SIGKILL
        began = time.monotonic()
        while any(map(_running, workers)):
            if time.monotonic() - began > WORKERS_END:
                raise Fault("hung", f"{sum(map(_running, workers))} workers live on")
            time.sleep(0.01)
    for part in folder.rglob("*.part"):
        os.utime(part, (0, 0))
    began = time.monotonic()
    _finish(folder, case.command)
    if time.monotonic() - began > LIMIT:
        raise Fault("hung", f"the last run took {time.monotonic() - began:.0f} s")
    results = _results(folder)
    if results != expected:
        names = {name for name in {*results, *expected} if results.get(name) != expected.get(name)}
        raise Fault("wrong", f"other results in {', '.join(sorted(names))}")
    if left := [path.name for path in folder.rglob("*") if path.suffix in (".part", ".checkpoint", ".damaged")]:
        raise Fault("wrong", f"temporary files are left: {left}")
    return f"killed {kills} times"


def _children(process: int) -> list[int]:
    try:
        return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


def _running(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
