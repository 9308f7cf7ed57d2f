"""Every public function and class has an example in its docstring, and the examples are true.

So has every function of the API reference; and the reference has every public name.
"""

from __future__ import annotations

import doctest
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

import nablahog
from tests.public_surface import members

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
IN_FULL = ("compat", "metrics", "presets")  # modules of which every function needs an example


def documented() -> Iterator[tuple[str, Any]]:
    """Public functions and classes by name, those of modules too."""
    for name in sorted({*nablahog.__all__} - {"__version__"}):
        yield from _functions(name, getattr(nablahog, name))


def _functions(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, ModuleType):
        if inspect.isclass(value) or inspect.isfunction(value):
            yield name, value
    elif name.split(".")[0] in IN_FULL:
        for inner, member in members(value).items():
            yield from _functions(f"{name}.{inner}", member)


def of_the_reference() -> Iterator[tuple[str, Any]]:
    """What the pages of the API reference list, by name."""
    for page in sorted((Path(__file__).parents[1] / "docs" / "api").glob("*.rst")):
        module = ""
        for line in page.read_text(encoding="utf-8").splitlines():
            if line.startswith(".. currentmodule:: nablahog"):
                module = line.removeprefix(".. currentmodule:: nablahog").lstrip(".")
            elif name := re.fullmatch(r" {3}(\w+)", line):
                # nablahog.presets is no module of its own
                within = nablahog.presets if module == "presets" else import_module(f"nablahog.{module}".rstrip("."))
                yield f"{module}.{name[1]}".lstrip("."), getattr(within, name[1])


REFERENCE = dict(of_the_reference())
EXAMPLES = dict(documented()) | {
    name: value for name, value in REFERENCE.items() if not inspect.isclass(value) or ">>>" in (value.__doc__ or "")
}


PACKAGE = Path(nablahog.__file__).parent
MODULES = [
    ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
    for file in sorted(PACKAGE.rglob("*.py"))
    if ">>> " in file.read_text(encoding="utf-8")
]


def test_every_public_function_has_an_example() -> None:
    assert [name for name, value in EXAMPLES.items() if ">>> " not in (value.__doc__ or "")] == []


@pytest.mark.parametrize("name", MODULES)
def test_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of private functions and of methods, too; each with these names and what it imports."""
    monkeypatch.chdir(tmp_path)
    names = {"nablahog": nablahog, "np": np, "torch": torch}
    tests = [test for test in doctest.DocTestFinder().find(import_module(name), name, globs=names) if test.examples]
    assert tests, f"no example of {name} is found"
    report: list[str] = []
    for test in tests:
        doctest.DocTestRunner(optionflags=FLAGS).run(test, out=report.append)
    assert not report, "".join(report)


def test_the_reference_is_whole() -> None:
    """Every public name has a page."""
    assert {name for name, _ in documented()} - set(REFERENCE) == set()
