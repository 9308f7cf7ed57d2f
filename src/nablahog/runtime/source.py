"""A hash of the code: results on disk are valid for the code that made them only."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
TALK = ("app", "cli", "compat", "viz")
"""Rooms that show results, and make none."""


def code_key(*definitions: Callable[..., Any]) -> str:
    """A hash of the code of this package, and of the files that define functions or classes elsewhere.

    Of the package, rooms that only show results count where they define something named.  Of compiled loops the
    sources count, or, where these are not installed, the library.

    Args:
        definitions: functions, ``functools.partial`` of functions, or classes, of any module.
    """
    return _key(frozenset(map(_file, definitions)))


@cache
def _key(files: frozenset[Path]) -> str:
    shown = {PACKAGE / room for room in TALK}
    code = {file for file in PACKAGE.rglob("*.py") if shown.isdisjoint(file.parents)}
    native = PACKAGE / "native"
    code |= {*native.glob("*.h"), *native.glob("*.cpp")} or {*native.glob("core.so")}
    contents = sorted((_name(file), hashlib.sha256(file.read_bytes()).hexdigest()) for file in code | files)
    return hashlib.sha256(repr(contents).encode()).hexdigest()


def _name(file: Path) -> str:
    """Independent of where the package is installed."""
    return file.relative_to(PACKAGE).as_posix() if file.is_relative_to(PACKAGE) else file.name


def _file(definition: Callable[..., Any]) -> Path:
    return Path(inspect.getfile(definition.func if isinstance(definition, partial) else definition))
