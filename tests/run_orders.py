"""Runs tests in other orders, processes and surroundings, and compares what each gives: ``make alone``.

    python -m tests.run_orders [tests/viz tests/io ...]

A test that passes in its file but not alone, or in a wide terminal but not in a narrow one, is a fault of the test, and
some day one of the package.  As a plugin of pytest this module shuffles tests.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
SEED = "NABLAHOG_TEST_ORDER"  # an environment variable of the plugin
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
    """Returns the outcome of each test, in processes that start in a folder."""
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary, "outcomes.xml")
        fixed = ["-q", "-p", "no:cacheprovider", "-p", "tests.run_orders", "-c", str(ROOT / "pyproject.toml")]
        chosen = ["-m", "not xslow"]
        environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}", **variables}
        files = (str(ROOT / test) for test in tests)
        command = [sys.executable, "-m", "pytest", *fixed, *chosen, f"--junitxml={path}", *arguments, *files]
        subprocess.run(command, cwd=folder, env=environment, capture_output=True)
        return {
            f"{case.get('classname')}::{case.get('name')}": case[0].tag if len(case) else "passed"
            for case in (ElementTree.parse(path).iter("testcase") if path.exists() else [])
        }


def list_files(tests: Sequence[str]) -> list[str]:
    """Returns the files of tests in some folders; files, and tests of files, as they are."""
    files: list[str] = []
    for test in tests:
        found = sorted((ROOT / test).rglob("test_*.py"))
        files += [str(file.relative_to(ROOT)) for file in found] or [test]
    return files


def run_everywhere(tests: Sequence[str]) -> dict[str, dict[str, str]]:
    """Returns the outcomes of tests in all surroundings."""
    outcomes: dict[str, dict[str, str]] = {}
    with tempfile.TemporaryDirectory() as elsewhere:
        runs = {name: (arguments, variables, ROOT) for name, (arguments, variables) in SURROUNDINGS.items()}
        runs["from another folder"] = [], {}, Path(elsewhere)
        runs["of somebody else"] = [], {"HOME": elsewhere, "USER": "somebody", "XDG_CACHE_HOME": ""}, ROOT
        for name, run in runs.items():
            start = time.monotonic()
            outcomes[name] = run_tests(tests, *run)
            print(f"{name:20} {len(outcomes[name]):6} tests {time.monotonic() - start:7.1f} s", flush=True)
    start = time.monotonic()
    by_file = outcomes["each file alone"] = {}
    for file in list_files(tests):
        by_file.update(run_tests([file], [], {}, ROOT))
    print(f"{'each file alone':20} {len(by_file):6} tests {time.monotonic() - start:7.1f} s", flush=True)
    return outcomes


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.run_orders", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tests", nargs="*", default=["tests"], help="folders and files")
    outcomes = run_everywhere(parser.parse_args().tests)
    faults = 0
    for test in sorted(set().union(*outcomes.values())):
        results = {name: of_run.get(test, "not run") for name, of_run in outcomes.items()}
        if set(results.values()) not in ({"passed"}, {"skipped"}):
            faults += 1
            print(test, *(f"    {result:13} {name}" for name, result in results.items()), sep="\n")
    print(f"{faults} tests differ or fail" if faults else "all equal")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
