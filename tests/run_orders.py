"""Runs tests in other orders, processes and surroundings, and compares what each gives: ``make alone``.

    python -m tests.run_orders [tests/viz tests/io ...] [--all]

A test that passes in its file but not alone, or in a wide terminal but not in a narrow one, is a fault of the test, and
some day one of the package.  Each file has a run of its own, and so have some tests, other ones every time; with
``--all``, all of them.  As a plugin of pytest this module shuffles tests.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import ChainMap
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
SEED = "NABLAHOG_TEST_ORDER"  # an environment variable of the plugin
SAMPLE = 40  # tests that have a run of their own
ALONE = "tests alone"
SURROUNDINGS: dict[str, tuple[list[str], dict[str, str]]] = {
    "as they stand": ([], {}),
    "random order": ([], {SEED: "68"}),
    "1 worker": (["-n", "1"], {}),
    "2 workers": (["-n", "2"], {}),
    "8 workers": (["-n", "8"], {}),
    "40 columns": ([], {"COLUMNS": "40"}),
    "200 columns": ([], {"COLUMNS": "200"}),
    "Kathmandu": ([], {"TZ": "Asia/Kathmandu"}),
    "no language": ([], {"LANG": "C", "LC_ALL": "C", "LANGUAGE": "C"}),
}
"""What each run is given: arguments of pytest, and variables of the environment."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if SEED in os.environ:
        random.Random(os.environ[SEED]).shuffle(items)


def run_tests(
    tests: Sequence[str], arguments: Sequence[str], variables: dict[str, str], folder: Path
) -> dict[str, str]:
    """Returns the outcome of each test by its address, in processes that start in a folder."""
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary, "outcomes.xml")
        fixed = ["-q", "-p", "no:cacheprovider", "-p", "tests.run_orders", "-c", str(ROOT / "pyproject.toml")]
        chosen = ["-m", "not xslow"]
        environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}", **variables}
        paths = (f"{ROOT}/{test}" for test in tests)
        command = [sys.executable, "-m", "pytest", *fixed, *chosen, f"--junitxml={path}", *arguments, *paths]
        subprocess.run(command, cwd=folder, env=environment, capture_output=True)
        outcomes = {}
        for case in ElementTree.parse(path).iter("testcase") if path.exists() else ():
            file = str(case.get("classname")).replace(".", "/")
            outcomes[f"{file}.py::{case.get('name')}"] = case[0].tag if len(case) else "passed"
        return outcomes


def list_files(tests: Sequence[str]) -> list[str]:
    """Returns the files of tests in some folders; files, and tests of files, as they are."""
    files: list[str] = []
    for test in tests:
        found = sorted((ROOT / test).rglob("test_*.py"))
        files += [str(file.relative_to(ROOT)) for file in found] or [test]
    return files


def run_everywhere(tests: Sequence[str], sample: int | None) -> dict[str, dict[str, str]]:
    """Returns the outcomes of tests in all surroundings, by file, and of a sample, or all, one by one."""
    outcomes: dict[str, dict[str, str]] = {}
    start = time.monotonic()

    def tell(name: str, of_run: dict[str, str]) -> None:
        nonlocal start
        outcomes[name] = of_run
        print(f"{name:20} {len(of_run):6} tests {time.monotonic() - start:7.1f} s", flush=True)
        start = time.monotonic()

    with tempfile.TemporaryDirectory() as elsewhere:
        runs = {name: (arguments, variables, ROOT) for name, (arguments, variables) in SURROUNDINGS.items()}
        runs["from another folder"] = [], {}, Path(elsewhere)
        runs["of somebody else"] = [], {"HOME": elsewhere, "USER": "somebody", "XDG_CACHE_HOME": ""}, ROOT
        for name, run in runs.items():
            tell(name, run_tests(tests, *run))
    tell("each file alone", dict(ChainMap(*(run_tests([file], [], {}, ROOT) for file in list_files(tests)))))
    known = sorted(set().union(*outcomes.values()))
    chosen = known if sample is None else random.sample(known, min(sample, len(known)))
    tell(ALONE, {test: run_tests([test], [], {}, ROOT).get(test, "not run") for test in chosen})
    return outcomes


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.run_orders", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tests", nargs="*", default=["tests"], help="folders and files")
    parser.add_argument("--all", action="store_true", help=f"run each test alone, not only {SAMPLE} of them")
    asked = parser.parse_args()
    for test in asked.tests:
        if not (ROOT / test.partition("::")[0]).exists():
            parser.error(f"there is no {test} in {ROOT}")
    outcomes = run_everywhere(asked.tests, None if asked.all else SAMPLE)
    tests = sorted(set().union(*outcomes.values()))
    if not tests:
        sys.exit(f"no test ran: does `python -m pytest {' '.join(asked.tests)}` find any?")
    faults = 0
    for test in tests:
        results = {
            name: of_run.get(test, "not run") for name, of_run in outcomes.items() if name != ALONE or test in of_run
        }
        if set(results.values()) not in ({"passed"}, {"skipped"}):
            faults += 1
            print(test, *(f"    {result:13} {name}" for name, result in results.items()), sep="\n")
    print(f"{faults} tests differ or fail" if faults else "all equal")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
