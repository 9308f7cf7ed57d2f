"""A change of one line, and the random choice of lines."""

from __future__ import annotations

import hashlib
import random
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.mutants import cpp_changes, python_changes

CHANGES: dict[str, Callable[[bytes], Iterator[tuple[int, int, int, str]]]] = {
    ".py": python_changes.find_changes,
    ".h": cpp_changes.find_changes,
    ".cpp": cpp_changes.find_changes,
}


class Checkout(NamedTuple):
    """A folder with a package, such as ``src/nablahog``, and with its tests in ``tests``."""

    root: Path
    package: Path

    def path(self, file: Path) -> Path:
        """Returns where a file of the package lies."""
        return self.root / self.package / file

    def digest(self, file: Path) -> str:
        """Returns a digest of a file of the package; empty where there is none."""
        return hashlib.sha256(self.path(file).read_bytes()).hexdigest()[:12] if self.path(file).exists() else ""

    def sources(self, under: list[str]) -> list[Path]:
        """Returns the files that can be broken, in some folders of the package or in all."""
        files = (path.relative_to(self.root / self.package) for path in (self.root / self.package).rglob("*"))
        return sorted(
            file for file in files
            if file.suffix in CHANGES and (not under or any(file.is_relative_to(folder) for folder in under))
        )  # fmt: skip


class Mutant(NamedTuple):
    """The text ``new`` in the place of the bytes ``start`` to ``end`` of a file."""

    file: Path
    digest: str  # of the file
    line: int
    text: str  # of the line
    start: int
    end: int
    old: str
    new: str

    @property
    def room(self) -> str:
        """The folder of the package, or its file, that the line belongs to."""
        return self.file.parts[0]

    @property
    def change(self) -> str:
        """Old and new text on one line."""
        return " ".join(f"{self.old} -> {self.new}".split())

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.change}"


def read_mutants(checkout: Checkout, file: Path) -> Iterator[Mutant]:
    """Yields all mutants of a file."""
    source, digest = checkout.path(file).read_bytes(), checkout.digest(file)
    lines = source.decode().splitlines()
    for line, start, end, new in CHANGES[file.suffix](source):
        yield Mutant(file, digest, line, lines[line - 1].strip(), start, end, source[start:end].decode(), new)


def draw_mutants(checkout: Checkout, under: list[str], count: int, seed: int) -> list[Mutant]:
    """Returns one mutant of each of so many random lines.

    A line's place in the order depends on its text alone: a larger count goes on with the same mutants, and a change of
    the package exchanges only those of the lines that it changes.
    """
    ranked: list[tuple[str, Mutant]] = []
    for file in checkout.sources(under):
        mutants_of_lines: dict[int, list[Mutant]] = {}
        for mutant in read_mutants(checkout, file):
            mutants_of_lines.setdefault(mutant.line, []).append(mutant)
        repeated: Counter[str] = Counter()
        for _, mutants in sorted(mutants_of_lines.items()):
            text = mutants[0].text
            repeated[text] += 1
            rank = hashlib.sha256(f"{seed} {file} {text} {repeated[text]}".encode()).hexdigest()
            ranked.append((rank, random.Random(rank).choice(mutants)))
    return [mutant for _, mutant in sorted(ranked)[:count]]
