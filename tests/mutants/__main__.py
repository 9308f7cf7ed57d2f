"""Breaks the package one line at a time, and lists the lines whose breaking no test notices: ``make mutants``.

    python -m tests.mutants [--count 200] [--seed 0] [--under hog pose/crop.py] [--minutes 60] [--part 3/20] [--all]
    python -m tests.mutants --report

Operators, comparisons, signs, numbers, returned values and the order of arguments are changed, and statements dropped,
in a copy of this checkout, in Python and in C++.  After each change, the tests that execute the line are run, the
quickest first; for C++ those that call it.  Which tests these are is recorded before, by coverage.py, in one run of
each file of tests that is new or has changed: of all tests, that takes longer than ``make test slow``; ``--tests viz``
takes those of one folder.  The record and the results are files in out/mutants: what has been tried is not tried again,
until the file of the line changes.

``--report`` lists the functions of tests: *alone*, some mutant is noticed by no other; *needed*, to notice all that
are noticed; *repeats* what these notice; *nothing* is noticed by it.
"""

from __future__ import annotations

import argparse
import itertools
import signal
import sys
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


def read_options(arguments: Sequence[str] | None, checkout: Checkout) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutants",
        description=(__doc__ or "").splitlines()[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=200, help="of lines to break")
    parser.add_argument("--seed", type=int, default=0, help="of the choice of lines")
    parser.add_argument("--under", nargs="*", default=[], metavar="NAME", help="folders or files of the package")
    parser.add_argument("--tests", nargs="*", default=[], metavar="NAME", help="folders or files of tests, else all")
    parser.add_argument("--part", default="1/1", metavar="K/N", help="the Kth of N parts of the lines")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="of trying, after the record is complete")
    parser.add_argument("--seconds", type=float, default=60, help="of tests for a mutant, the quickest of them")
    parser.add_argument("--all", action="store_true", help="list all tests that notice a mutant, not only the first")
    parser.add_argument("--again", action="store_true", help="try those that survived again")
    parser.add_argument("--report", action="store_true", help="try nothing; say which tests the mutants need")
    parser.add_argument("--out", type=Path, default=Path("out", "mutants"), metavar="FOLDER", help="of the results")
    options = parser.parse_args(arguments)
    for folder, names in ((checkout.root / checkout.package, options.under), (checkout.root / "tests", options.tests)):
        for name in names:
            if not (folder / name).exists():
                parser.error(f"there is no {name} in {folder.relative_to(checkout.root)}")
    return options


def main(arguments: Sequence[str] | None, checkout: Checkout, preloaded: Sequence[str] = ()) -> None:
    """Tries the mutants that the command asks for, and prints what the tests say to them."""
    options = read_options(arguments, checkout)
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
                if name not in record.runs:
                    print(f"recording tests/{name}", flush=True)
                    record.add(name, tree.path)
            end = time.monotonic() + 60 * options.minutes
            for mutant in itertools.takewhile(lambda _: time.monotonic() < end, drawn):
                known = results.find(mutant)
                if known is None or (options.all and not known.complete) or (options.again and not known.noticed):
                    result = try_mutant(mutant, tree, record, options.seconds, options.all)
                    results.add(result)
                    state = "noticed " if result.noticed else "SURVIVED" if result.counts else "same C++"
                    print(f"{state} {mutant}", flush=True)
    print("\nwith those tried before", *summarize(drawn, results, read_equivalent()), sep="\n")
    if options.report:
        valid = [result for result in map(results.find, drawn) if result is not None]
        print("\nkind\tmutants noticed alone\tmutants noticed\ttest", *judge_tests(valid, record.seconds), sep="\n")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # removes the copy
    try:
        main(None, HERE, PRELOADED)
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
