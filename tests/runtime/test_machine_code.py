"""Machine code on disk: damage costs time only, and what others may have written is not loaded."""

from __future__ import annotations

import errno
import os
import pickle
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import platformdirs
import pytest

from nablahog.runtime import machine_code
from nablahog.runtime.cache_folder import cache_folder
from nablahog.runtime.machine_code import CODE, DAY, DIGEST, UNUSED, _digest, _read, _tidy, _write, code_folder
from nablahog.runtime.processor import level

from .code_server import CodeServer

RIGHT = "6.0 81"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CodeServer]:
    started = CodeServer(tmp_path_factory.mktemp("functions"))
    yield started
    started.close()


@pytest.fixture(scope="module")
def made(server: CodeServer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the machine code of both functions."""
    folder = tmp_path_factory.mktemp("made")
    assert server.ask(folder) == (0, f"{RIGHT} 0")
    assert server.ask(folder) == (0, f"{RIGHT} 2")
    return folder


@pytest.fixture
def cache(made: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(made, tmp_path / "cache")


def files(cache: Path) -> list[Path]:
    return sorted((cache / "machine-code").iterdir())


def test_for_the_owner_alone_whatever_the_umask(cache: Path) -> None:
    assert len(files(cache)) == 2
    assert {file.stat().st_mode & 0o777 for file in files(cache)} == {0o600}
    assert (cache / "machine-code").stat().st_mode & 0o777 == 0o700


@pytest.fixture(scope="module")
def general(tmp_path_factory: pytest.TempPathFactory, server: CodeServer) -> Path:
    """A cache with machine code for the level of this processor, of the same functions."""
    its_level = level()
    if its_level is None:
        pytest.skip("this processor has no level")
    folder = tmp_path_factory.mktemp("general")
    other = CodeServer(server.folder, its_level.environment())
    assert other.ask(folder) == (0, f"{RIGHT} 0")
    other.close()
    return folder


def test_code_for_a_level_is_of_use_to_processors_that_have_it(general: Path, made: Path, server: CodeServer) -> None:
    assert server.ask(general) == (0, f"{RIGHT} 2")
    assert not {file.name for file in files(general)} & {file.name for file in files(made)}


def test_code_of_a_wheel(general: Path, tmp_path: Path, server: CodeServer) -> None:
    shipped = shutil.copytree(general / "machine-code", tmp_path / "shipped")
    for file in shipped.iterdir():
        file.chmod(0o666)  # whoever can write in the package needs no machine code
    assert server.ask(tmp_path / "cache", shipped=shipped) == (0, f"{RIGHT} 2")
    assert not files(tmp_path / "cache")
    for file in shipped.iterdir():
        file.write_bytes(flipped(-1)(file.read_bytes()))
    assert server.ask(tmp_path / "cache", shipped=shipped) == (0, f"{RIGHT} 0")
    assert len(files(tmp_path / "cache")) == 2


def flipped(position: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:position] + bytes([data[position] ^ 1]) + data[position + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:10],
        lambda data: data[: len(data) // 2],
        lambda data: data[:-9],
        lambda data: data + b"x",
        lambda data: bytes(len(data)),
        lambda data: data[::-1],
        *map(flipped, (0, DIGEST, DIGEST + 3, 5000, -1)),
    ],
)
def test_damage(cache: Path, server: CodeServer, damage: Callable[[bytes], bytes]) -> None:
    for file in files(cache):
        file.write_bytes(damage(file.read_bytes()))
    assert server.ask(cache) == (0, f"{RIGHT} 0")
    assert server.ask(cache) == (0, f"{RIGHT} 2")
    assert len(files(cache)) == 2


def test_of_one_function_under_the_name_of_the_other(cache: Path, server: CodeServer) -> None:
    first, second = files(cache)
    contents = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(contents)
    assert server.ask(cache) == (0, f"{RIGHT} 0")


def test_what_a_changed_numba_cannot_read(cache: Path, server: CodeServer) -> None:
    for file, payload in zip(files(cache), (pickle.dumps(("no", "code")), b"no pickle"), strict=True):
        key = bytes.fromhex(file.stem.rpartition("-")[2])
        file.write_bytes(_digest(payload, key) + payload)
    assert server.ask(cache) == (0, f"{RIGHT} 0")
    assert server.ask(cache) == (0, f"{RIGHT} 2")


class _Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, int]]:
        return os.mkdir, (str(self.marker), 0o700)


def test_what_others_may_write_is_not_unpickled(tmp_path: Path) -> None:
    path, key = tmp_path / f"f{CODE}", b"key"
    payload = pickle.dumps(_Trap(tmp_path / "marker"))
    _write(path, _digest(payload, key) + payload)
    assert _read(path, key) == payload
    assert _read(path, b"another key") is None
    for mode in (0o620, 0o602, 0o666):
        path.chmod(mode)
        assert _read(path, key) is None
    path.unlink()
    path.symlink_to(tmp_path / "elsewhere")
    assert _read(path, key) is None


def test_what_another_user_owns_is_not_unpickled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, key = tmp_path / f"f{CODE}", b"key"
    _write(path, _digest(b"x", key) + b"x")
    assert _read(path, key) == b"x"
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert _read(path, key) is None


def test_a_folder_that_others_may_write(cache: Path, server: CodeServer) -> None:
    (cache / "machine-code").chmod(0o770)
    before = [(file, file.read_bytes()) for file in files(cache)]
    status, text = server.ask(cache)
    assert status == 0
    assert text.endswith(f"{RIGHT} 0")
    assert text.count("each process compiles") == 1
    assert "it belongs to others, or others may write it" in text
    assert [(file, file.read_bytes()) for file in files(cache)] == before


def test_a_full_disk(tmp_path: Path, server: CodeServer) -> None:
    for largest in (0, 1000):
        status, text = server.ask(tmp_path, largest)
        assert (status, text.count(f"they cannot be kept ({tmp_path}")) == (0, 1)
        assert text.endswith(f"{RIGHT} 0")
        assert not files(tmp_path)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EACCES])
def test_a_failure_of_the_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    def fail(*paths: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match=os.strerror(code)):
        _write(tmp_path / "f", b"x")
    assert not os.listdir(tmp_path)


def test_no_folder(tmp_path: Path, server: CodeServer) -> None:
    (tmp_path / "file").touch()
    status, text = server.ask(tmp_path / "file")
    assert (status, text.count("each process compiles")) == (0, 1)
    assert f"{tmp_path / 'file'}" in text
    assert "NABLAHOG_CACHE_DIR" in text
    assert text.endswith(f"{RIGHT} 0")


def test_where_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def chosen() -> Path | None:
        code_folder.cache_clear()
        return code_folder()

    monkeypatch.setattr(machine_code, "__file__", str(tmp_path / "package" / "runtime" / "machine_code.py"))
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: Path("~/.cache") / name)  # without a home
    monkeypatch.delenv("NABLAHOG_CACHE_DIR", raising=False)
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", "")
    with pytest.raises(FileNotFoundError, match="the user has no home, and NABLAHOG_CACHE_DIR is not set"):
        cache_folder()
    assert chosen() == tmp_path / "package" / "__pycache__" / "machine-code"
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "user" / name)
    assert chosen() == tmp_path / "user" / "nablahog" / "machine-code"
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(tmp_path / "numba"))
    assert chosen() == tmp_path / "numba" / "nablahog" / "machine-code"
    monkeypatch.setenv("NABLAHOG_CACHE_DIR", str(tmp_path / "own"))
    assert chosen() == tmp_path / "own" / "machine-code"
    code_folder.cache_clear()


def test_what_nobody_uses_is_removed(tmp_path: Path) -> None:
    ages = {"new.code": 0.0, "used.code": UNUSED - DAY, "old.code": UNUSED + DAY, "old.txt": UNUSED + DAY}
    ages |= {"new.part": DAY / 2, "old.part": DAY * 2}
    for name, age in ages.items():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time.time() - age,) * 2)
    _tidy(tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["new.code", "new.part", "old.txt", "used.code"]


def test_what_is_read_is_in_use(tmp_path: Path) -> None:
    path = tmp_path / f"f{CODE}"
    _write(path, _digest(b"x", b"key") + b"x")
    os.utime(path, (0, 0))
    assert _read(path, b"key") == b"x"
    assert time.time() - path.stat().st_mtime < DAY
