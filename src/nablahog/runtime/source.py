"""Hashes of the code that makes a result: results on disk are valid for this code only.

The code is the file that defines a function and, transitively, all modules of this package that it imports, read from
the import statements: nothing is listed by hand, so nothing can be left out.  Whoever imports the compiled loops
depends on their sources, or, where these are not installed, on the library.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
# Parsing whole files would take most of a second.
_IMPORT = re.compile(r"^[ \t]*((?:from[ \t]+[.\w]+[ \t]+)?import[ \t]+(?:\([^)]*\)|[^\n(#]+))", re.MULTILINE)
_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n((?:[ \t]+.*\n|\n)*)", re.MULTILINE)


def code_key(*definitions: Callable[..., Any]) -> str:
    """A hash of the code that functions or classes consist of, this package's only.

    Args:
        definitions: functions, ``functools.partial`` of functions, or classes, of any module.
    """
    return _key(tuple(dict.fromkeys(map(_file, definitions))))


def imported_files(*files: Path, package: Path = PACKAGE) -> set[Path]:
    """The files themselves and all modules of the package that they import, directly or not.

    Imports inside functions count; those for type checkers only do not.  A name that a package loads when it is used
    (:mod:`.lazy`) counts as its module.

    Args:
        files: modules, of the package or not.
        package: the folder of the package.
    """
    reached: set[Path] = set()
    waiting = list(files)
    while waiting:
        file = waiting.pop()
        if file not in reached:
            reached.add(file)
            waiting += _imports(file, package)
    return reached


@cache
def _key(files: tuple[Path, ...]) -> str:
    deciding = imported_files(*files, package=PACKAGE)
    if PACKAGE / "native" / "__init__.py" in deciding:
        deciding |= _of_loops(PACKAGE / "native")
    contents = sorted((_name(file), hashlib.sha256(file.read_bytes()).hexdigest()) for file in deciding)
    return hashlib.sha256(repr(contents).encode()).hexdigest()


def _of_loops(folder: Path) -> set[Path]:
    """What the compiled loops are made from; the library of an installation, as others are of the same sources."""
    return {*folder.glob("*.h"), *folder.glob("*.cpp")} or {*folder.glob("core.so")}


def _name(file: Path) -> str:
    """Independent of where the package is installed."""
    return file.relative_to(PACKAGE).as_posix() if file.is_relative_to(PACKAGE) else file.name


def _file(definition: Callable[..., Any]) -> Path:
    return Path(inspect.getfile(definition.func if isinstance(definition, partial) else definition))


def _imports(file: Path, package: Path) -> Iterator[Path]:
    """The modules that a module imports itself, and the packages that it is in."""
    for folder in file.parents:
        if not folder.is_relative_to(package):
            break
        yield folder / "__init__.py"
    for statement in _statements(_FOR_TYPES.sub("", file.read_text(encoding="utf-8"))):
        yield from _targets(statement, file, package)


@cache
def _statements(text: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    statements: list[ast.Import | ast.ImportFrom] = []
    for match in _IMPORT.finditer(text):
        with suppress(SyntaxError):  # a line of a docstring
            statements += [each for each in ast.parse(match[1]).body if isinstance(each, ast.Import | ast.ImportFrom)]
    return tuple(statements)


def _targets(statement: ast.Import | ast.ImportFrom, file: Path, package: Path) -> Iterator[Path]:
    """The modules that one import statement of a file loads."""
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            yield from _module(package.parent.joinpath(*alias.name.split(".")), package)
        return
    if not statement.level and (statement.module or "").split(".")[0] != package.name:
        return  # of another package
    base = file.parents[statement.level - 1] if statement.level else package.parent
    for module in _module(base.joinpath(*(statement.module or "").split(".")), package):
        yield module
        if module.name == "__init__.py":
            for alias in statement.names:
                yield from _member(module, alias.name, package)


def _module(path: Path, package: Path) -> list[Path]:
    """The file of a module or package by its path without ending; none if it is of another package."""
    files = (path.with_name(f"{path.name}.py"), path / "__init__.py")
    return [file for file in files if file.is_relative_to(package) and file.is_file()][:1]


def _member(init: Path, name: str, package: Path) -> Iterator[Path]:
    """The module that defines a name of a package: what its ``__init__`` imports it from, for type checkers too."""
    for each in _statements(init.read_text(encoding="utf-8")):
        if isinstance(each, ast.ImportFrom) and each.module and name in (a.asname or a.name for a in each.names):
            yield from _targets(each, init, package)
            return
    yield from _module(init.parent / name, package)
