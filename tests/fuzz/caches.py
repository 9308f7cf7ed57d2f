"""Damaged machine code: functions are compiled again, with the right result; nothing of others is ever unpickled."""

from __future__ import annotations

import os
import pickle
import random
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from hypothesis import strategies

from nablahog.runtime.machine_code import DIGEST, _digest

from ..runtime.code_server import CodeServer
from .harness import Fault

LIMIT = 20.0  # seconds
DAMAGES = (
    "empty",
    "truncated",
    "longer",
    "one bit",
    "bytes",
    "zeros",
    "garbage",
    "a pickle",
    "a pickle in place of the contents",
    "swapped",
    "removed",
    "a folder",
    "a dangling link",
    "writable by others",
    "not readable",
)
FOLDERS = ("sound", "sound", "sound", "sound", "writable by others", "read-only", "a full disk")


@dataclass(frozen=True)
class Case:
    """Damage of one cache.

    Attributes:
        damages: of its files, one after another, each by number and kind.
        folder: what is wrong with the folder or the disk.
        seed: of what is random.
    """

    damages: tuple[tuple[int, str], ...]
    folder: str
    seed: int


cases = strategies.builds(
    Case,
    strategies.lists(strategies.tuples(strategies.integers(0, 1), strategies.sampled_from(DAMAGES)), max_size=4).map(
        tuple
    ),
    strategies.sampled_from(FOLDERS),
    strategies.integers(0, 2**32),
)


class _Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, int]]:
        return os.makedirs, (str(self.marker), 0o700)


@cache
def _sound() -> tuple[CodeServer, Path]:
    """The process that calls the functions, and a cache with their machine code."""
    folder = Path(tempfile.mkdtemp(prefix="nablahog-caches-"))
    server, made = CodeServer(folder), folder / "made"
    answer = server.ask(made)
    if answer != (0, "6.0 81 0"):
        raise Fault("wrong", f"before any damage: {answer}")
    return server, made


def close() -> None:
    """Ends the process and removes its folder."""
    if _sound.cache_info().currsize:
        server, made = _sound()
        server.close()
        shutil.rmtree(made.parent)
        _sound.cache_clear()


@contextmanager
def _copy_of(made: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield shutil.copytree(made, Path(folder) / "cache")


def check(case: Case) -> str:
    """Damages a cache and calls the functions twice.

    Returns:
        How many of the two functions were read from disk after the damage.

    Raises:
        Fault: the process died, took long, gave another result, told more than one sentence, or unpickled something.
    """
    server, made = _sound()
    with _copy_of(made) as folder:
        code, marker = folder / "machine-code", folder / "marker"
        paths, rng = sorted(code.iterdir()), random.Random(case.seed)
        for number, damage in case.damages:
            _damage(paths[number], paths[1 - number], damage, marker, rng)
        if case.folder == "writable by others":
            code.chmod(rng.choice((0o720, 0o702, 0o777)))
            for path in filter(Path.is_file, paths):
                _damage(path, path, "writable by others", marker, rng)
                path.chmod(0o600)
        elif case.folder == "read-only":
            code.chmod(0o500)
        limit = rng.choice((0, 100, 9000)) if case.folder == "a full disk" else None
        began = time.monotonic()
        answers = [server.ask(folder, limit) for _ in range(2)]
        seconds = time.monotonic() - began
        if marker.exists():
            raise Fault("wrong", "a pickle was read that nobody had checked")
        blocked = case.folder != "sound" or any(path.is_dir() for path in paths)
        for answer in answers:
            if answer.status:
                raise Fault("crashed", f"exit status {answer.status}: {answer.text[-500:]}")
            if answer.text.rpartition("\n")[2][:-2] != "6.0 81":
                raise Fault("wrong", answer.text)
            if answer.text.count("\n") > blocked:  # which a warning says
                raise Fault("unclear", answer.text)
        if seconds > LIMIT:
            raise Fault("hung", f"{seconds:.1f} s")
        if not blocked and answers[1].text[-1] != "2":
            raise Fault("wrong", f"the cache is not repaired: {answers[1].text}")
        if left := [path.name for path in code.glob("*.part")]:
            raise Fault("wrong", f"temporary files are left: {left}")
        code.chmod(0o700)
        return f"{answers[0].text[-1]} of 2 read"


def _damage(path: Path, other: Path, damage: str, marker: Path, rng: random.Random) -> None:
    if path.is_dir() or path.is_symlink() or not path.exists():
        return
    path.chmod(0o600)
    data = path.read_bytes()
    trap = pickle.dumps(_Trap(marker))
    start, length = rng.randrange(len(data) + 1), rng.randrange(1, 100)
    changed = {
        "empty": b"",
        "truncated": data[:start],
        "longer": data + rng.randbytes(length),
        "bytes": data[:start] + rng.randbytes(length) + data[start + length :],
        "zeros": bytes(len(data)),
        "garbage": rng.randbytes(length * 100),
        "a pickle": trap,
        "a pickle in place of the contents": data[:DIGEST] + trap,
    }
    if damage in changed:
        path.write_bytes(changed[damage])
    elif damage == "one bit" and start < len(data):
        path.write_bytes(data[:start] + bytes([data[start] ^ 1 << rng.randrange(8)]) + data[start + 1 :])
    elif damage == "swapped" and other.is_file():
        path.write_bytes(other.read_bytes())
        other.write_bytes(data)
    elif damage == "removed":
        path.unlink()
    elif damage == "a folder":
        path.unlink()
        path.mkdir()
    elif damage == "a dangling link":
        path.unlink()
        path.symlink_to("nowhere")
    elif damage == "writable by others":
        key = bytes.fromhex(path.stem.rpartition("-")[2])
        path.write_bytes(_digest(trap, key) + trap)  # by somebody who knows how
        path.chmod(rng.choice((0o620, 0o602, 0o666)))
    elif damage == "not readable":
        path.chmod(0)
