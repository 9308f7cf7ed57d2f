"""Prints the table: ``python -m tests.boundary``; with ``--failing`` each failing cell and its error."""

from __future__ import annotations

import argparse
import os
import pickle
import sys
import time
from collections import Counter
from pathlib import Path

import torch

from nablahog.runtime.pytorch import load_forward_mode

from .columns import COLUMNS
from .rows import ROWS
from .table import Cell, Column, Row, numbers, run_cell

SIGNS = {"equal": "=", "refused": "r", "failing": "X", "none": " "}


def write_plain_results(path: str) -> None:
    """Of all columns, for the rows of other processes."""
    results = {}
    for column in COLUMNS.values():
        use = column.use("context")
        try:
            results[column.name] = numbers(use.call(use.plain(use.base)))
        except Exception as error:
            results[column.name] = f"{type(error).__name__}: {error}"
    Path(path).write_bytes(pickle.dumps(results))


def show(table: dict[tuple[str, str], Cell], rows: list[Row], columns: list[Column]) -> None:
    """The table in signs: = equal, r refused with a remedy, X failing."""
    for number, column in enumerate(columns):
        print(f"{'':36}{'│' * number}┌ {column.name}")
    for row in rows:
        cells = [table.get((row.name, column.name)) for column in columns]
        print(f"{row.name[:35]:36}{''.join(' ' if cell is None else SIGNS[cell.state] for cell in cells)}")
    counts = Counter(cell.state for cell in table.values())
    print(
        f"{len(rows)} rows, {len(columns)} columns, {sum(counts.values()) - counts['none']} cells: "
        f"{counts['equal']} equal, {counts['refused']} refused, {counts['failing']} failing"
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.boundary")
    parser.add_argument("--rows", default="", help="rows whose name begins with this")
    parser.add_argument("--columns", default="", help="columns whose name begins with this")
    parser.add_argument("--failing", action="store_true", help="list the failing cells, each with its error")
    parser.add_argument("--refused", action="store_true", help="list the refusals")
    parser.add_argument("--times", action="store_true", help="list the seconds of each column")
    parser.add_argument("--plain", metavar="FILE", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    os.environ["NABLAHOG_CACHE_SIZE"] = "0"
    torch.set_num_threads(1)
    load_forward_mode()
    if asked.plain:
        write_plain_results(asked.plain)
        return 0
    rows = [row for row in ROWS.values() if row.name.startswith(asked.rows)]
    columns = [column for column in COLUMNS.values() if column.name.startswith(asked.columns)]
    table: dict[tuple[str, str], Cell] = {}
    seconds: Counter[str] = Counter()
    for column in columns:
        began = time.process_time()
        table |= {(row.name, column.name): run_cell(row, column) for row in rows if column.takes(row)}
        seconds[column.name] = round(time.process_time() - began, 1)  # type: ignore[assignment]
    for (row, column), cell in table.items():
        if (cell.state == "failing" and asked.failing) or (cell.state == "refused" and asked.refused):
            print(f"{cell.state}: {row} | {column} | {cell.where} | {cell.detail}")
    if asked.times:
        print(seconds)
    show(table, rows, columns)
    return any(cell.state == "failing" for cell in table.values())


if __name__ == "__main__":
    sys.exit(main())
