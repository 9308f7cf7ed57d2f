"""Hashes of code: every change of what makes a result counts."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import pytest

from nablahog.cli.main import main
from nablahog.runtime import source
from nablahog.runtime.source import code_key


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package, whose code is hashed."""
    package = tmp_path / "nablahog"
    shutil.copytree(source.PACKAGE, package, ignore=shutil.ignore_patterns("*.so", "__pycache__", "*.npz"))
    monkeypatch.setattr(source, "PACKAGE", package)
    source._key.cache_clear()
    return package


@pytest.mark.parametrize(
    ("file", "counts"),
    [("hog/spec.py", True), ("native/gradient.h", True), ("jobs/store.py", True), ("cli/main.py", False)],
)
def test_a_change(copy: Path, file: str, counts: bool) -> None:
    before = code_key()
    source._key.cache_clear()
    assert code_key() == before
    (copy / file).write_text((copy / file).read_text() + "\n")
    source._key.cache_clear()
    assert (code_key() != before) == counts


def test_definitions_elsewhere_count() -> None:
    assert len({code_key(), code_key(test_definitions_elsewhere_count), code_key(main)}) == 3
    assert code_key(partial(main, [])) == code_key(main)
