"""Where files that can be made again are kept, and hashes of the code: every change of what makes a result counts."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import platformdirs
import pytest

from nablahog.cli.main import main
from nablahog.runtime import cache
from nablahog.runtime.cache import VARIABLE, cache_folder, code_key


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package, whose code is hashed."""
    package = tmp_path / "nablahog"
    shutil.copytree(cache.PACKAGE, package, ignore=shutil.ignore_patterns("*.so", "__pycache__", "*.npz"))
    monkeypatch.setattr(cache, "PACKAGE", package)
    cache._key.cache_clear()
    return package


@pytest.mark.parametrize(
    ("file", "counts"),
    [("hog/spec.py", True), ("native/gradient.h", True), ("jobs/store.py", True), ("cli/main.py", False)],
)
def test_a_change(copy: Path, file: str, counts: bool) -> None:
    before = code_key()
    cache._key.cache_clear()
    assert code_key() == before
    (copy / file).write_text((copy / file).read_text() + "\n")
    cache._key.cache_clear()
    assert (code_key() != before) == counts


def test_definitions_elsewhere_count() -> None:
    assert len({code_key(), code_key(test_definitions_elsewhere_count), code_key(main)}) == 3
    assert code_key(partial(main, [])) == code_key(main)


def test_where_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    assert cache_folder() == tmp_path / "nablahog"
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"


def test_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: Path("~/.cache") / name)
    with pytest.raises(FileNotFoundError, match=VARIABLE):
        cache_folder()
