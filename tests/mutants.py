"""Breaks the package one line at a time, and lists the lines whose breaking no test notices: ``make mutants``.

    python -m tests.mutants [--count 200] [--seed 0] [--under hog pose/crop.py] [--out out/mutants.tsv]

Operators, comparisons, signs, numbers and returned values are changed in a copy of this checkout.  For each change run
the tests that execute the line, as coverage.py has recorded it in one run of the whole suite, the quickest first; for a
line that runs when its module is imported, those that enter any function of the file.  Tests that start processes of
their own are run last, with those of the same folder.  The record and the results are files; the same command
resumes a run that was stopped.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

ROOT = Path(__file__).parent.parent
PACKAGE = Path("src", "nablahog")
LIMIT = 600  # seconds of the tests of a mutant; those that take longer have noticed an endless loop
QUICK = 2.0  # seconds of a test that is run among the first
MOST = 400  # tests of a run
STARTING_PROCESSES = (
    "cli",
    "app",
    "jobs",
    "runtime",
)  # rooms whose lines are executed in processes that coverage.py does not see
OPERATORS: dict[type, type] = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult},
    **{ast.Pow: ast.Mult, ast.Mod: ast.FloorDiv, ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr},
    **{ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In},
}


class Mutant(NamedTuple):
    """The text ``new`` in the place of the bytes ``start`` to ``end`` of a file."""

    file: Path
    line: int
    start: int
    end: int
    new: str


def changed(node: ast.AST) -> ast.AST | None:
    """The expression in the place of another; None for one that stays."""
    match node:
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            return ast.BinOp(left, OPERATORS[type(operator)](), right)
        case ast.BoolOp(operator, values):
            return ast.BoolOp(OPERATORS[type(operator)](), values)
        case ast.Compare(left, [first, *others], right):
            return ast.Compare(left, [OPERATORS[type(first)](), *others], right)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            return operand
        case ast.Constant(bool() as value):
            return ast.Constant(not value)
        case ast.Constant(int() as value):
            return ast.Constant(value + 1)
        case ast.Constant(float() as value) if not 0 < value < 1e-6:  # else only against division by 0
            return ast.Constant(1.25 * value or 1.0)
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            return ast.Return(ast.UnaryOp(ast.USub(), value))
        case ast.AugAssign(target, operator, value) if type(operator) in OPERATORS:
            return ast.AugAssign(target, OPERATORS[type(operator)](), value)
    return None


def breakable(node: ast.AST) -> Iterator[ast.AST]:
    """What can be changed in a node: no type, overload, decorator, docstring or message."""
    skipped: list[ast.AST | None] = []
    match node:
        case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.If(ast.Name("TYPE_CHECKING")):
            return
        case ast.FunctionDef(decorator_list=[ast.Name("overload")]):
            return
        case ast.FunctionDef(decorator_list=decorators, returns=returns):
            skipped = [*decorators, returns]
        case ast.ClassDef(decorator_list=decorators):
            skipped = [*decorators]
        case ast.AnnAssign(annotation=annotation) | ast.arg(annotation=annotation):
            skipped = [annotation]
        case ast.Call(ast.Attribute(attr="warn" | "add_argument")) | ast.keyword(arg="strict"):  # the latter: of zip
            return
    if changed(node) is not None:
        yield node
    for child in ast.iter_child_nodes(node):
        if child not in skipped:
            yield from breakable(child)


def mutants(file: Path) -> Iterator[Mutant]:
    """All of a file of the package."""
    source = (ROOT / PACKAGE / file).read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in breakable(ast.parse(source)):
        assert isinstance(node, ast.expr | ast.stmt)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        span = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        new = ast.unparse(ast.fix_missing_locations(changed(node) or node))
        yield Mutant(file, node.lineno, *span, f"({new})" if isinstance(node, ast.expr) else new)


def drawn(under: list[str], count: int, seed: int) -> list[Mutant]:
    """One mutant of each of so many random lines."""
    lines: dict[tuple[Path, int], list[Mutant]] = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        file = path.relative_to(ROOT / PACKAGE)
        if not under or any(file.is_relative_to(each) for each in under):
            for mutant in mutants(file):
                lines.setdefault((mutant.file, mutant.line), []).append(mutant)
    chance, order = random.Random(seed), sorted(lines)
    chance.shuffle(order)  # so that a larger count goes on with the same mutants
    return [random.Random(f"{seed} {line}").choice(lines[line]) for line in order[:count]]


class Record:
    """Which tests execute which lines, and how long they take: of a run of the suite in a copy of the checkout."""

    def __init__(self, folder: Path, tree: Path) -> None:
        data, report = folder / "coverage", folder / "tests.xml"
        if not report.exists():
            wanted = ["--cov=nablahog", "--cov-context=test", "--cov-report=", f"--junitxml={report}"]
            tested(tree, *wanted, "-n", "2", "--maxfail=20", limit=None, COVERAGE_FILE=str(data))
        self.seconds: dict[str, float] = {}
        for case in ElementTree.parse(report).iter("testcase"):
            if case.find("failure") is None and case.find("error") is None:  # what fails anyhow notices every mutant
                module = case.get("classname", "").replace(".", "/")
                self.seconds[f"{module}.py::{case.get('name')}"] = float(case.get("time", 0))
        self.data = CoverageData(str(data))
        self.data.read()
        self.files = {Path(file.rpartition("/src/nablahog/")[2]): file for file in self.data.measured_files()}

    def tests(self, file: Path, line: int) -> list[str]:
        """Those that execute a line, or else any line of the file after it was imported; the quickest first."""
        if file not in self.files:
            return []
        of_lines = self.data.contexts_by_lineno(self.files[file])
        contexts = of_lines.get(line, [])
        if not any(contexts):  # executed by an import alone
            contexts = [context for each in of_lines.values() for context in each]
        names = {context.split("|")[0] for context in contexts} & self.seconds.keys()
        return sorted(names, key=self.seconds.__getitem__)


def runs(mutant: Mutant, record: Record) -> Iterator[list[str]]:
    """Tests to run: those that execute the line, then the folder of the room, whose tests may start processes."""
    recorded = record.tests(mutant.file, mutant.line)
    quick = [name for name in recorded if record.seconds[name] < QUICK][:MOST]
    yield from ([quick] if quick else [])
    slow = [name for name in recorded if name not in quick][:MOST]
    yield from ([slow] if slow else [])
    room = mutant.file.parts[0].removesuffix(".py")
    folder = next((each for each in (f"tests/{room}", f"tests/test_{room}.py") if (ROOT / each).exists()), None)
    if folder is not None and (room in STARTING_PROCESSES or not recorded):
        yield [folder, "tests/test_start_up.py"]


def tested(tree: Path, *arguments: str, limit: float | None, **variables: str) -> subprocess.CompletedProcess[str]:
    """Runs pytest in a copy of the checkout."""
    paths = {"PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}", "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    environment = {**os.environ, **paths, **variables}
    return subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, timeout=limit)


def noticed(mutant: Mutant, tree: Path, record: Record) -> str:
    """The first test that fails with the mutant in a copy of the checkout; empty for a survivor."""
    path = tree / PACKAGE / mutant.file
    source, names = path.read_bytes(), tree / "tests.txt"
    try:
        path.write_bytes(source[: mutant.start] + mutant.new.encode() + source[mutant.end :])
        for tests in runs(mutant, record):
            names.write_text("\n".join(tests))
            try:
                done = tested(tree, "-x", f"@{names}", limit=LIMIT)
            except subprocess.TimeoutExpired:
                return "too slow"
            if done.returncode not in (0, 5):  # 5: no tests
                told = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return told[0][:150] if told else f"exit status {done.returncode}"
    finally:
        path.write_bytes(source)
    return ""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--under", nargs="*", default=[], metavar="ROOM", help="folders or files of src/nablahog")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutants.tsv")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.touch()
    done = dict(line.split("\t", 1) for line in options.out.read_text().splitlines())
    ignored = shutil.ignore_patterns(".*", "out", "build", "dist", "__pycache__")
    with tempfile.TemporaryDirectory() as folder, options.out.open("a") as file:
        tree = Path(folder, "nablahog")
        shutil.copytree(ROOT, tree, ignore=ignored)
        record = Record(options.out.parent, tree)
        for mutant in drawn(options.under, options.count, options.seed):
            old = (ROOT / PACKAGE / mutant.file).read_bytes()[mutant.start : mutant.end].decode()
            name = " ".join(f"{mutant.file}:{mutant.line}: {old} -> {mutant.new}".split())
            if name not in done:
                done[name] = noticed(mutant, tree, record)
                print(f"{name}\t{done[name]}", file=file, flush=True)
            print(f"{'noticed ' if done[name] else 'SURVIVED'} {name}", flush=True)
    survivors = [name for name, test in done.items() if not test]
    print(f"\n{len(done) - len(survivors)} of {len(done)} noticed\n", *survivors, sep="\n")


if __name__ == "__main__":
    main()
