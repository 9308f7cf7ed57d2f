"""Files of every format that the package reads, damaged in ways that know the format.

Each case is read in a process of its own, which is used again until it dies, under limits of time and memory.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import selectors
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from hypothesis import strategies as st

from .file_mutations import mutated
from .file_seeds import seeds
from .harness import Fault, check_sentence

SECONDS = 5.0  # of the processor until a file is refused: the machine may be busy with something else
PATIENCE = 30.0  # seconds on the clock, after which a reader waits for something that never comes
START = 300.0  # seconds until it has imported everything
BYTES = 2**30  # beyond the process at the start, until a file is refused
CORPUS = Path(__file__).parent / "corpus" / "files"


@dataclass(frozen=True)
class FileCase:
    """A file.

    Attributes:
        reader: of :data:`.file_server.READERS`.
        ending: of its name.
        data: what it holds.
        made: which seed and mutations made it; empty if it is from the corpus.
    """

    reader: str
    ending: str
    data: bytes
    made: str = ""

    def __repr__(self) -> str:
        return f"{self.reader}{self.ending}, {len(self.data):,} bytes, {self.made}"


def _case(name: str, number: int) -> FileCase:
    seed = seeds()[name]
    data, how = mutated(seed, Random(number))
    return FileCase(seed.reader, seed.ending, data, f"{name}, {number}: {how}")


cases: st.SearchStrategy[FileCase] = st.deferred(
    lambda: st.builds(_case, st.sampled_from(sorted(seeds())), st.integers(0, 2**48))
)


def close() -> None:
    """Ends the process that reads, and removes its folder."""
    if server.cache_info().currsize:
        server().close()
        server.cache_clear()


def figures() -> dict[str, str]:
    """The most that a refused file took in this process, with the case."""
    (most_bytes, largest), (most_seconds, slowest) = server().most_bytes, server().most_seconds
    return {"peak": f"{most_bytes / 1e6:.0f} MB: {largest}", "time": f"{most_seconds:.2f} s: {slowest}"}


def corpus() -> dict[str, FileCase]:
    """Files that found something, by name, which begins with that of the reader."""
    paths = sorted(CORPUS.iterdir())
    return {path.name: FileCase(path.name.partition("-")[0], path.suffix, path.read_bytes()) for path in paths}


class Server:
    """The process that reads.

    Attributes:
        most_bytes, most_seconds: of a file that was refused, so far, with its case.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="nablahog-fuzz-"))
        self.process: subprocess.Popen[bytes] | None = None
        self.most_bytes: tuple[int, str] = (0, "")
        self.most_seconds: tuple[float, str] = (0.0, "")
        atexit.register(self.close)

    def close(self) -> None:
        self._end()
        shutil.rmtree(self.folder, ignore_errors=True)

    def read(self, case: FileCase) -> dict[str, Any]:
        """The server's answer.

        Raises:
            Fault: there is none.
        """
        path = self.folder / f"case{case.ending}"
        path.write_bytes(case.data)
        return self.read_path(case.reader, path)

    def read_path(self, reader: str, path: Path) -> dict[str, Any]:
        """As :meth:`read`, of a file that exists."""
        process = self._started()
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps([reader, str(path)]).encode() + b"\n")
            process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._line(PATIENCE))
        if answer["outcome"] in ("crashed", "hung"):
            raise Fault(answer["outcome"], answer["message"])
        return answer

    def _line(self, patience: float) -> bytes:
        """What the process says next."""
        assert self.process is not None
        assert self.process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            if not selector.select(patience):
                self._end()
                raise Fault("hung", f"not done after {patience:.0f} s")
        line = self.process.stdout.readline()
        if not line:
            status = self.process.wait()
            self._end()
            raise Fault("crashed", f"the process ended with status {status}")
        return line

    def _started(self) -> subprocess.Popen[bytes]:
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.file_server"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=Path(__file__).parents[2],
                env={**os.environ, "OMP_NUM_THREADS": "1"},
            )
            assert self._line(START) == b"ready\n"
        return self.process

    def _end(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for pipe in (self.process.stdin, self.process.stdout):
                if pipe is not None:
                    with contextlib.suppress(BrokenPipeError):
                        pipe.close()
            self.process = None


@cache
def server() -> Server:
    """One for all cases of this process."""
    return Server()


def check(case: FileCase) -> str:
    """Reads a file: ``read`` or ``refused``.

    Raises:
        Fault: another exception, the end of the process, no clear sentence, more time or memory than the limits before
            the file is refused, or more than those of the process for one that is read.
    """
    answer = server().read(case)
    if answer["outcome"] == "refused":
        check_sentence(answer["message"])
        server().most_bytes = max(server().most_bytes, (answer["bytes"], repr(case)))
        server().most_seconds = max(server().most_seconds, (answer["seconds"], repr(case)))
        if answer["seconds"] > SECONDS or answer["bytes"] > BYTES:
            took = f"{answer['seconds']:.1f} s and {answer['bytes']:,} bytes"
            raise Fault("hung", f"refused after {took}: {answer['message']}")
    return str(answer["outcome"])
