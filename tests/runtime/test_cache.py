"""Where files that can be made again are kept, and hashes of the code: every change of what makes a result counts."""

from __future__ import annotations

import importlib
import shutil
import sys
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import platformdirs
import pytest

from nablahog.cli.main import main
from nablahog.runtime import cache
from nablahog.runtime.cache import FOLDER_VARIABLE, cache_folder, code_key

INSTALLED = Path(cache.__file__).parents[1]
FILES = [file.relative_to(INSTALLED) for file in INSTALLED.rglob("*") if file.is_file()]
SHIPPED = [file for file in FILES if "__pycache__" not in file.parts and not file.name.endswith(cache.COMPILED)]
ONE_OF_EACH = sorted({(file.parent, file.suffix): file for file in sorted(SHIPPED)}.values())
"""A file of each kind in each folder."""


def key_of(package: Any, monkeypatch: pytest.MonkeyPatch) -> str:
    """The key of a package in another place."""
    monkeypatch.setattr(cache, "PACKAGE", package)
    cache._key_of_package.cache_clear()
    return code_key()


@pytest.fixture
def copy(tmp_path: Path) -> Iterator[Path]:
    """A package with files of the same names, which are short."""
    package = tmp_path / "nablahog"
    for file in ONE_OF_EACH:
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text(file.as_posix())
    yield package
    cache._key_of_package.cache_clear()


def test_every_file_counts(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert {".py", ".pyi", ".cpp", ".h", ".npz", ".html", ".js", ".css", ".csv"} <= {
        file.suffix for file in ONE_OF_EACH
    }
    keys = {key_of(copy, monkeypatch)}
    for file in ONE_OF_EACH:
        (copy / file).write_text("edited")
        keys.add(key_of(copy, monkeypatch))
        (copy / file).write_text(file.as_posix())
    assert len(keys) == 1 + len(ONE_OF_EACH)
    assert key_of(copy, monkeypatch) in keys
    part = code_key(parts=("hog/", "io/"))
    for file, counts in (("cli/main.py", False), ("hog/spec.py", True)):
        (copy / file).write_text("edited")
        cache._key_of_package.cache_clear()
        assert (code_key(parts=("hog/", "io/")) != part) == counts


def test_what_is_compiled_counts_without_its_sources(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = key_of(copy, monkeypatch)
    (copy / "hog" / "__pycache__").mkdir()
    (copy / "hog" / "__pycache__" / "spec.pyc").touch()
    (copy / "native" / "core.so").touch()
    (copy / "hog" / ".spec.py.swp").touch()  # of an editor
    assert key_of(copy, monkeypatch) == before
    for file in (*copy.glob("native/*.cpp"), *copy.glob("native/*.h")):
        file.unlink()
    before = key_of(copy, monkeypatch)
    (copy / "native" / "core.so").write_text("compiled anew")
    assert key_of(copy, monkeypatch) != before


def test_a_package_in_an_archive(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = shutil.make_archive(str(copy), "zip", copy.parent, copy.name)
    assert key_of(zipfile.Path(archive, "nablahog/"), monkeypatch) == key_of(copy, monkeypatch)


def test_a_program_that_holds_all_code(copy: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "program"
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    monkeypatch.setattr(sys, "executable", str(program))
    keys = set()
    for version in ("1", "22"):
        program.write_text(version)
        keys.add(key_of(copy, monkeypatch))
    assert len(keys) == 2


def test_definitions_elsewhere_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert code_key(main) == code_key(partial(main, [])) == code_key()
    here = code_key(test_definitions_elsewhere_count)
    assert here == code_key(partial(key_of, 1), main) != code_key()
    with zipfile.ZipFile(tmp_path / "methods.zip", "w") as archive:
        archive.writestr("method_in_an_archive.py", "def method(): pass")
    monkeypatch.syspath_prepend(tmp_path / "methods.zip")
    method = importlib.import_module("method_in_an_archive").method
    assert len({code_key(), here, code_key(method), code_key(method, key_of)}) == 4


def test_where_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    assert cache_folder() == tmp_path / "nablahog"
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"


def test_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: Path("~/.cache") / name)
    with pytest.raises(FileNotFoundError, match=FOLDER_VARIABLE):
        cache_folder()
