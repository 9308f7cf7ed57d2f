"""Which tests execute which lines, and how long they take: of one run of each part of the tests."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from coverage import CoverageData

from tests.mutants.mutant import Checkout
from tests.mutants.runs import run_tests

PART_LIMIT = 3600.0  # seconds of the tests of a part
BUDGET = 120.0  # seconds of the tests of a mutant
STARTING_PROCESSES = ("cli", "app", "jobs", "runtime")  # rooms whose lines run in processes that coverage.py misses


def list_parts(root: Path) -> list[str]:
    """Returns the folders and files directly in ``tests`` that have tests."""
    files = (path.relative_to(root / "tests") for path in (root / "tests").rglob("test_*.py"))
    return sorted({file.parts[0] for file in files} - {"mutants"})


def digest_tests(root: Path, part: str) -> str:
    """Returns a digest of the Python files of a part of the tests."""
    entry = root / "tests" / part
    digest = hashlib.sha256()
    for path in sorted(entry.rglob("*.py")) if entry.is_dir() else [entry]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


class Record:
    """The lines that tests execute.

    Attributes:
        seconds: of each test that passes.
    """

    def __init__(self, checkout: Checkout, folder: Path, parts: list[str]) -> None:
        self.checkout = checkout
        self.folder = folder
        self.parts: dict[str, tuple[dict[str, Any], CoverageData]] = {}
        self.seconds: dict[str, float] = {}
        for part in parts:
            if self._has(part):
                self._load(part)

    def _has(self, part: str) -> bool:
        path = self.folder / f"{part}.json"
        return path.exists() and json.loads(path.read_text())["tests"] == digest_tests(self.checkout.root, part)

    def _load(self, part: str) -> None:
        data = CoverageData(str(self.folder / f"{part}.coverage"))
        data.read()
        description = json.loads((self.folder / f"{part}.json").read_text())
        self.parts[part] = description, data
        self.seconds.update(description["seconds"])

    def add(self, part: str, tree: Path) -> None:
        """Runs a part of the tests in a copy of the checkout, unless the record has it as it is now."""
        if part in self.parts:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        # coverage.py reads its settings from the folder that it runs in
        settings, data = tree / "coverage.cfg", self.folder / f"{part}.coverage"
        data.unlink(missing_ok=True)
        settings.write_text(f"[run]\ndata_file = {data}\nsource = {self.checkout.package.name}\n")
        wanted = (f"--cov-config={settings}", "--cov", "--cov-context=test", "--cov-report=")
        outcomes = run_tests(tree, [f"tests/{part}"], PART_LIMIT, *wanted)
        if not any(outcome.result == "passed" for outcome in outcomes):
            raise RuntimeError(f"no test of tests/{part} passes: {(tree / 'output.txt').read_text()[-1000:]}")
        description = {
            "tests": digest_tests(self.checkout.root, part),
            "seconds": {outcome.test: outcome.seconds for outcome in outcomes if outcome.result == "passed"},
            "sources": {str(file): self.checkout.digest(file) for file in self.checkout.sources([])},
        }
        (self.folder / f"{part}.json").write_text(json.dumps(description, indent=1))
        self._load(part)

    def tests(self, file: Path, line: int) -> list[str]:
        """Returns the tests that execute a line, or else any line of the file after its import; the quickest first.

        For a line of C++, those that execute a line of Python that calls a function of a library built from the file.
        """
        lines = [(file, line)] if file.suffix == ".py" else list(find_calls(self.checkout, file))
        contexts = {context for pair in lines for context in self._contexts(*pair)}
        names = {context.split("|")[0] for context in contexts} & self.seconds.keys()
        if not names and file.parts[0].removesuffix(".py") in STARTING_PROCESSES:
            names = {test for test in self.seconds if f"tests/{file.parts[0]}/" in test}
        ordered = sorted(names, key=self.seconds.__getitem__)
        total = 0.0
        wanted: list[str] = []
        for test in ordered:
            total += self.seconds[test]
            if total > BUDGET and wanted:
                break
            wanted.append(test)
        return wanted

    def _contexts(self, file: Path, line: int) -> Iterator[str]:
        for description, data in self.parts.values():
            measured = [path for path in data.measured_files() if Path(path).match(str(self.checkout.package / file))]
            for path in measured:
                of_lines = data.contexts_by_lineno(path)
                same = description["sources"].get(str(file)) == self.checkout.digest(file)
                contexts = of_lines.get(line, []) if same else []
                if not any(contexts):  # executed by an import alone, or elsewhere in the file than when it was recorded
                    contexts = [context for contexts in of_lines.values() for context in contexts]
                yield from contexts


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
