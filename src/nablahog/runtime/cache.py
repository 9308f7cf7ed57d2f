"""Results that are kept on disk: where, and a hash of the code, for which alone they are valid."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.abc import Traversable

FOLDER_VARIABLE = "NABLAHOG_CACHE_DIR"
NAME = "nablahog"
PACKAGE = files(NAME)
SOURCES, COMPILED = (".cpp", ".h"), (".so", ".sha256")


def cache_folder() -> Path:
    """The folder that the environment variable ``NABLAHOG_CACHE_DIR`` names, else one of the user's caches.

    It need not exist.

    Raises:
        FileNotFoundError: the user has no home.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named).absolute()
    from platformdirs import user_cache_path

    path = user_cache_path(NAME)
    if not path.is_absolute():  # "~" where there is no home
        raise FileNotFoundError(
            f"there is no folder for caches: the user has no home, and {FOLDER_VARIABLE} is not set"
        )
    return path


def code_key(*definitions: Callable[..., Any], parts: tuple[str, ...] = ("",)) -> str:
    """A hash of the files of this package, and of the files that define functions or classes elsewhere.

    Whatever the package is installed with counts: code, pages, data.  Of compiled loops the sources count, or, where
    these are not installed, the libraries.

    Args:
        definitions: functions or classes; those of this package change nothing.  A ``functools.partial`` stands for
            its function.
        parts: what the paths of the files begin with; by default all files count.
    """
    functions = (definition.func if isinstance(definition, partial) else definition for definition in definitions)
    modules = sorted({function.__module__ for function in functions})
    keys = [_key_of_module(module) for module in modules if module.partition(".")[0] != NAME]
    return hashlib.sha256(repr([_key_of_package(parts), *keys]).encode()).hexdigest()


@cache
def _key_of_package(parts: tuple[str, ...]) -> str:
    contents = {path: file for path, file in _files(PACKAGE) if path.startswith(parts)}
    if any(path.endswith(SOURCES) for path in contents):
        contents = {path: file for path, file in contents.items() if not path.endswith(COMPILED)}
    hashes: list[Any] = [
        (path, hashlib.sha256(file.read_bytes()).hexdigest()) for path, file in sorted(contents.items())
    ]
    if getattr(sys, "frozen", False):  # a program that holds the code of all its modules
        state = os.stat(sys.executable)
        hashes.append((state.st_mtime_ns, state.st_size))
    return hashlib.sha256(repr(hashes).encode()).hexdigest()


def _files(folder: Traversable, parent: str = "") -> Iterator[tuple[str, Traversable]]:
    """The files below a folder, which may lie in an archive, and their paths from there.

    Not what Python compiles, and no hidden files, such as editors leave.
    """
    for entry in folder.iterdir():
        path = f"{parent}{entry.name}"
        if entry.name.startswith(".") or entry.name == "__pycache__":
            continue
        if entry.is_dir():
            yield from _files(entry, f"{path}/")
        else:
            yield path, entry


@cache
def _key_of_module(name: str) -> str:
    return hashlib.sha256(inspect.getsource(sys.modules[name]).encode()).hexdigest()
