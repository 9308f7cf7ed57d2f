"""Results that are kept on disk: where, and a hash of the code, for which alone they are valid."""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

VARIABLE = "NABLAHOG_CACHE_DIR"
PACKAGE = Path(__file__).parents[1]
TALK = ("app", "cli", "compat", "viz")
"""Rooms that show results, and make none."""


def cache_folder() -> Path:
    """The folder that the environment variable ``NABLAHOG_CACHE_DIR`` names, else one of the user's caches.

    It need not exist.

    Raises:
        FileNotFoundError: the user has no home.
    """
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given).absolute()
    from platformdirs import user_cache_path

    path = user_cache_path("nablahog")
    if not path.is_absolute():  # "~" where there is no home
        raise FileNotFoundError(f"there is no folder for caches: the user has no home, and {VARIABLE} is not set")
    return path


def code_key(*definitions: Callable[..., Any]) -> str:
    """A hash of the code of this package, and of the files that define functions or classes elsewhere.

    Definitions may be a ``functools.partial`` of a function, too.  Rooms of the package that only show results count
    where they define one.  Of compiled loops the sources count, or, where these are not installed, the library.
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
