"""The file of results, one line of JSON for each mutant, and what they say about the tests."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.mutants.mutant import Mutant

EQUIVALENT = Path(__file__).parent / "equivalent.tsv"
"""Mutants that change nothing: the file, the text of the line, the change, and why, separated by tabs."""


@dataclass
class Result:
    """What the tests said to a mutant.

    Attributes:
        mutant: its line and its change.
        key: the file, its digest, the bytes that were changed, and the new text.
        noticed: tests that failed.
        passed: functions of tests of which none failed.
        complete: whether all were run; else up to the first that failed.
        counts: False for C++ that does not compile, or that the compiler makes the same code of.
    """

    mutant: str
    key: list[str | int]
    noticed: list[str]
    passed: list[str] = field(default_factory=list)
    complete: bool = False
    counts: bool = True

    @property
    def room(self) -> str:
        return self.mutant.partition(":")[0].partition("/")[0]


def key_of(mutant: Mutant) -> list[str | int]:
    """Returns what a result is found by: it stays valid as long as the file is what it was."""
    return [str(mutant.file), mutant.digest, mutant.start, mutant.end, mutant.new]


def function_name(test: str) -> str:
    """Returns the function of a test, without the values that it was run with."""
    return test.partition("[")[0]


def file_name(test: str) -> str:
    """Returns the file of a test."""
    return test.partition("::")[0]


class Results:
    """The results that a file has; further ones are appended."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.by_key: dict[str, Result] = {}
        if path.exists():
            for line in path.read_text().splitlines():
                result = Result(**json.loads(line))
                self.by_key[json.dumps(result.key)] = result

    def find(self, mutant: Mutant) -> Result | None:
        return self.by_key.get(json.dumps(key_of(mutant)))

    def add(self, result: Result) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a") as file:
            print(json.dumps(asdict(result)), file=file)
        self.by_key[json.dumps(result.key)] = result


def read_equivalent(path: Path = EQUIVALENT) -> set[tuple[str, str, str]]:
    """Returns the file, the text of the line, and the change of mutants that no test can notice."""
    lines = (line.split("\t") for line in path.read_text().splitlines() if line)
    return {(file, text, change) for file, text, change, _ in lines}


def summarize(mutants: Iterable[Mutant], results: Results, equivalent: set[tuple[str, str, str]]) -> Iterator[str]:
    """Yields the survivors and a table: mutants of each room, how many are equivalent, how many were noticed."""
    counts: dict[str, Counter[str]] = {}
    for mutant in mutants:
        result = results.find(mutant)
        if result is None or not result.counts:
            continue
        count = counts.setdefault(mutant.room, Counter())
        count["tried"] += 1
        if result.noticed:
            count["noticed"] += 1
        elif (str(mutant.file), mutant.text, mutant.change) in equivalent:
            count["equivalent"] += 1
        else:
            yield f"SURVIVED {mutant}"
    total = sum(counts.values(), Counter())
    yield f"{'folder':12} {'tried':>7} {'equivalent':>11} {'noticed':>8} {'share':>7}"
    for room, count in [*sorted(counts.items()), ("all", total)]:
        share = count["noticed"] / max(count["tried"] - count["equivalent"], 1)
        yield f"{room:12} {count['tried']:7} {count['equivalent']:11} {count['noticed']:8} {share:7.1%}"


def judge_tests(results: Iterable[Result], recorded: Iterable[str]) -> Iterator[str]:
    """Yields the functions of tests: those that alone notice a mutant, those that help, and those that no mutant needs.

    A mutant counts that all tests were run with, and that lets their files be imported.  A few functions notice all
    mutants together; those that only repeat them are not needed, as far as these mutants go.
    """
    noticed = [
        {function_name(test) for test in result.noticed}
        for result in results
        if result.complete and result.noticed and all("::" in test for test in result.noticed)
    ]
    alone = Counter(next(iter(names)) for names in noticed if len(names) == 1)
    times = Counter(name for names in noticed for name in names)
    needed = set(alone)
    left = [names for names in noticed if not names & needed]
    while left:
        best = max(
            sorted({name for names in left for name in names}), key=lambda name: sum(name in names for names in left)
        )
        needed.add(best)
        left = [names for names in left if best not in names]
    for name in sorted(needed):
        yield f"{'alone' if alone[name] else 'needed'}\t{alone[name]}\t{times[name]}\t{name}"
    for name in sorted({function_name(test) for test in recorded} - needed):
        yield f"{'repeats' if times[name] else 'nothing'}\t0\t{times[name]}\t{name}"
