"""Breaks the package one line at a time, and lists the lines whose breaking no test notices: ``make mutants``.

    python -m tests.mutants [--count 200] [--seed 0] [--under hog pose/crop.py] [--minutes 60] [--part 3/20] [--all]
    python -m tests.mutants --report

Operators, comparisons, signs, numbers, returned values and the order of arguments are changed, and statements dropped,
in a copy of this checkout, in Python and in C++.  For each change run the tests that execute the line, the quickest
first, as coverage.py has recorded it in one run of each file of tests; for C++ those that call it.  The record and
the results are files in out/mutants: what has been tried is not tried again, until the file of the line changes.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tests.mutants.coverage_record import Record, list_test_files
from tests.mutants.mutant import Checkout, Mutant, draw_mutants
from tests.mutants.results import (
    Result,
    Results,
    file_name,
    function_name,
    judge_tests,
    key_of,
    read_equivalent,
    summarize,
)
from tests.mutants.runs import PRELOADED, Outcome, Tree, preload, run_all_tests, run_tests

HERE = Checkout(Path(__file__).parents[2], Path("src", "nablahog"))


def limit_of(seconds: float) -> float:
    """Returns the seconds after which tests that take so many are stopped: they have noticed an endless loop."""
    return 60 + 5 * seconds


def try_mutant(mutant: Mutant, tree: Tree, record: Record, seconds: float, all_tests: bool) -> Result:
    """Runs the tests of a mutant, all of them or up to the first that notices it."""
    tests = record.tests(mutant.file, mutant.line, seconds)
    result = Result(str(mutant), key_of(mutant), [], complete=all_tests)
    with tree.broken(mutant) as result.counts:
        if not result.counts or not tests:
            return result
        if all_tests:
            run = run_all_tests(tree.path, tests, limit_of(record.sum_seconds(tests)))
        else:
            run = run_until_noticed(tree, record, tests)
    result.noticed = [outcome.test for outcome in run if outcome.result != "passed"]
    functions = {function_name(outcome.test) for outcome in run}
    result.passed = sorted(functions - {function_name(test) for test in result.noticed})
    return result


def run_until_noticed(tree: Tree, record: Record, tests: Sequence[str]) -> list[Outcome]:
    """Runs tests up to the first that fails: those of the file with most of them before all files are imported."""
    (name, _), *_ = Counter(map(file_name, tests)).most_common(1)
    outcomes: list[Outcome] = []
    for first in (True, False):
        group = [test for test in tests if (file_name(test) == name) == first]
        if group and all(outcome.result == "passed" for outcome in outcomes):
            outcomes += run_tests(tree.path, group, limit_of(record.sum_seconds(group)), "-x")
    return outcomes


def read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="lines")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--under", nargs="*", default=[], metavar="ROOM", help="folders or files of src/nablahog")
    parser.add_argument("--tests", nargs="*", default=[], metavar="FOLDER", help="folders or files of tests; else all")
    parser.add_argument("--part", default="1/1", metavar="K/N", help="the Kth of N parts of the lines")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="after which no further line is tried")
    parser.add_argument("--seconds", type=float, default=60, help="of tests for a mutant, the quickest of them")
    parser.add_argument("--all", action="store_true", help="list all tests that notice a mutant, not only the first")
    parser.add_argument("--again", action="store_true", help="try those that survived again")
    parser.add_argument("--report", action="store_true", help="try nothing; say which tests the mutants need")
    parser.add_argument("--out", type=Path, default=Path("out", "mutants"), metavar="FOLDER")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None, checkout: Checkout, preloaded: Sequence[str] = ()) -> None:
    """Tries the mutants that the command asks for, and prints what the tests say to them."""
    options = read_options(arguments)
    end = time.monotonic() + 60 * options.minutes
    out = checkout.root / options.out
    results = Results(out / "results.jsonl")
    test_files = list_test_files(checkout.root, options.tests)
    record = Record(checkout, out / "coverage", test_files)
    part, count = map(int, options.part.split("/"))
    drawn = draw_mutants(checkout, options.under, options.count, options.seed)[part - 1 :: count]
    if not options.report:
        preload(preloaded)
        with tempfile.TemporaryDirectory() as folder:
            tree = Tree(checkout, Path(folder))
            for name in test_files:
                record.add(name, tree.path)
            for mutant in itertools.takewhile(lambda _: time.monotonic() < end, drawn):
                known = results.find(mutant)
                if known is None or (options.all and not known.complete) or (options.again and not known.noticed):
                    result = try_mutant(mutant, tree, record, options.seconds, options.all)
                    results.add(result)
                    state = "noticed " if result.noticed else "SURVIVED" if result.counts else "same C++"
                    print(f"{state} {mutant}", flush=True)
    print(*summarize(drawn, results, read_equivalent()), sep="\n")
    if options.report:
        valid = [result for result in map(results.find, drawn) if result is not None]
        print(*judge_tests(valid, record.seconds), sep="\n")


if __name__ == "__main__":
    main(None, HERE, PRELOADED)
