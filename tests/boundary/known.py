"""Cells that fail for a cause that is known, in ``known.txt``: who repairs one deletes it there."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FILE = Path(__file__).with_name("known.txt")
UNSORTED = "not looked into yet"
Causes = dict[str, dict[str, list[str]]]  # rows by column, by cause


def read_causes() -> Causes:
    causes: Causes = {}
    cells: dict[str, list[str]] = {}
    for line in FILE.read_text(encoding="utf-8").splitlines() if FILE.exists() else ():
        if line.startswith("# "):
            cells = causes.setdefault(line[2:], {})
        elif line:
            column, rows = line.split(": ", 1)
            cells.setdefault(column, []).extend(rows.split(" | "))
    return causes


def known_failures() -> dict[tuple[str, str], str]:
    """The causes by (row, column)."""
    return {
        (row, column): cause for cause, cells in read_causes().items() for column, rows in cells.items() for row in rows
    }


def write_failures(failures: Iterable[tuple[str, str]]) -> None:
    """Writes the cells that fail now, each under its cause."""
    known, causes = known_failures(), dict.fromkeys([*read_causes(), UNSORTED])
    found: Causes = {cause: {} for cause in causes}
    for row, column in failures:
        found[known.get((row, column), UNSORTED)].setdefault(column, []).append(row)
    blocks = [
        "\n".join([f"# {cause}", *(f"{column}: {' | '.join(rows)}" for column, rows in cells.items())])
        for cause, cells in found.items()
        if cells
    ]
    FILE.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")
