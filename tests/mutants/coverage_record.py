"""Which tests execute which lines, and how long they take: of one run of each file of tests."""

from __future__ import annotations

import ast
import hashlib
import itertools
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from coverage import CoverageData

from tests.mutants.mutant import Checkout
from tests.mutants.runs import run_tests

FILE_LIMIT = 1200.0  # seconds of the tests of a file


def list_test_files(root: Path, wanted: list[str]) -> list[str]:
    """Returns the files of tests, of some folders of ``tests`` or of all but the tool's own."""
    files = (path.relative_to(root / "tests") for path in (root / "tests").rglob("test_*.py"))
    return sorted(
        str(file)
        for file in files
        if (any(map(file.is_relative_to, wanted)) if wanted else not file.is_relative_to("mutants"))
    )


class Record:
    """The lines that tests execute.

    Attributes:
        seconds: of each test that passes.
    """

    def __init__(self, checkout: Checkout, folder: Path, test_files: list[str]) -> None:
        self.checkout = checkout
        self.folder = folder
        self.runs: dict[str, tuple[dict[str, Any], CoverageData]] = {}
        self.seconds: dict[str, float] = {}
        self._known: dict[tuple[Path, int | None], set[str]] = {}  # tests that execute a line
        for name in test_files:
            if self._has(name):
                self._load(name)

    def _has(self, name: str) -> bool:
        path = self.folder / f"{name}.json"
        return path.exists() and json.loads(path.read_text())["digest"] == self._digest(name)

    def _load(self, name: str) -> None:
        data = CoverageData(str(self.folder / f"{name}.coverage"))
        data.read()
        description = json.loads((self.folder / f"{name}.json").read_text())
        self.runs[name] = description, data
        self._known.clear()
        self.seconds.update(description["seconds"])

    def _digest(self, name: str) -> str:
        return hashlib.sha256((self.checkout.root / "tests" / name).read_bytes()).hexdigest()[:12]

    def add(self, name: str, tree: Path) -> None:
        """Runs a file of tests in a copy of the checkout."""
        # coverage.py reads its settings from the folder that it runs in
        settings, data = tree / "coverage.cfg", self.folder / f"{name}.coverage"
        data.parent.mkdir(parents=True, exist_ok=True)
        data.unlink(missing_ok=True)
        settings.write_text(f"[run]\ndata_file = {data}\nsource = {self.checkout.package.name}\n")
        wanted = (f"--cov-config={settings}", "--cov", "--cov-context=test", "--cov-report=")
        outcomes = run_tests(tree, [f"tests/{name}"], FILE_LIMIT, *wanted)
        if outcomes and not any(outcome.result == "passed" for outcome in outcomes):
            raise RuntimeError(f"no test of tests/{name} passes: {(tree / 'output.txt').read_text()[-1000:]}")
        description = {
            "digest": self._digest(name),
            "seconds": {outcome.test: outcome.seconds for outcome in outcomes if outcome.result == "passed"},
            "sources": {str(file): self.checkout.digest(file) for file in self.checkout.sources([])},
        }
        (self.folder / f"{name}.json").write_text(json.dumps(description, indent=1))
        self._load(name)

    def sum_seconds(self, tests: Iterable[str]) -> float:
        """Returns how long tests take together."""
        return sum(self.seconds[test] for test in tests)

    def tests(self, file: Path, line: int, most_seconds: float) -> list[str]:
        """Returns the tests that execute a line, quick ones first, for so many seconds.

        For a line that an import runs, those that execute any function of the file, and those of its room; for a line
        of C++, those that execute a line of Python that calls a function of a library built from the file.  For a line
        of Python, those of its room come first, for half of the seconds.
        """
        of_room = self._room_tests(file)
        if file.suffix != ".py":
            names = {test for place in find_calls(self.checkout, file) for test in self._executing(*place)}
            return self._quickest(names or of_room, most_seconds)
        if is_in_function(self.checkout.path(file).read_bytes(), line):
            names = self._executing(file, line)
        else:  # whatever test first needs a module imports it
            names = self._executing(file) | of_room
        names = names or of_room  # that start processes, which coverage.py does not see
        first = self._quickest(names & of_room, most_seconds / 2)
        return first + self._quickest(names - {*first}, most_seconds - self.sum_seconds(first))

    def _quickest(self, names: set[str], most_seconds: float) -> list[str]:
        """Those of some tests that are done in so many seconds, and one if there is any."""
        ordered = sorted(names, key=self.seconds.__getitem__)
        totals = itertools.accumulate(map(self.seconds.__getitem__, ordered))
        return [
            test for k, (test, total) in enumerate(zip(ordered, totals, strict=True)) if not k or total <= most_seconds
        ]

    def _executing(self, file: Path, line: int | None = None) -> set[str]:
        """The tests that execute a line of Python, or any line of a file."""
        if (file, line) not in self._known:
            self._known[file, line] = self._find_executing(file, line)
        return self._known[file, line]

    def _find_executing(self, file: Path, line: int | None) -> set[str]:
        contexts: set[str] = set()
        for description, data in self.runs.values():
            for path in data.measured_files():
                if path.endswith(f"/{self.checkout.package / file}"):
                    of_lines = data.contexts_by_lineno(path)
                    same = description["sources"].get(str(file)) == self.checkout.digest(file)  # else numbers moved
                    contexts.update(*([of_lines.get(line, [])] if same and line else of_lines.values()))
        return {context.split("|")[0] for context in contexts} & self.seconds.keys()

    def _room_tests(self, file: Path) -> set[str]:
        room = file.parts[0].removesuffix(".py")
        return {test for test in self.seconds if test.startswith((f"tests/{room}/", f"tests/test_{room}.py"))}


def is_in_function(source: bytes, line: int) -> bool:
    """Returns whether a line of Python is run by a call, not by the import of its file."""
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
    return any(node.body[0].lineno <= line <= (node.end_lineno or 0) for node in functions)


def find_calls(checkout: Checkout, file: Path) -> Iterator[tuple[Path, int]]:
    """Yields the lines of Python that call functions of C++ in which a file takes part."""
    native = checkout.path(file).parent
    texts = {path.name: path.read_text() for path in native.iterdir() if path.suffix in (".h", ".cpp")}
    users = {file.name}
    while True:
        more = {name for name, text in texts.items() if any(f'#include "{used}"' in text for used in users)} - users
        if not more:
            break
        users |= more
    called = {name for user in users for name in re.findall(rf"\b{checkout.package.name}_(\w+)\(", texts[user])}
    for path in sorted((checkout.root / checkout.package).rglob("*.py")):
        text = path.read_text()
        for bound, name in re.findall(r"^(\w+) = native\.function\(\s*\"(\w+)\"", text, re.MULTILINE):
            for number, line in enumerate(text.splitlines(), 1):
                if name in called and re.search(rf"\b{bound}\b(?! = )", line):
                    yield path.relative_to(checkout.root / checkout.package), number
