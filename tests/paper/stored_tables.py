"""Both tables of fake methods, as text: their files, their pages, and what the terminal shows.

``python -m tests.paper.stored_tables`` writes ``stored/``.  What the methods do is known (:mod:`.fakes`), so that most
of the figures can be told by hand: 8° too far is 75 % of 4 views.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import replace
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import pytest
import torch

from nablahog.paper import table1_page, table2_page
from nablahog.paper.methods import METHODS, ReconstructionMethod, Table1Settings
from nablahog.paper.names import UOCTTI
from nablahog.paper.pose_methods import Table2Settings
from nablahog.paper.table1 import Table1, write_table1
from nablahog.paper.table2 import Table2, run_table2, write_table2
from nablahog.viz.html import figure

from .common import made, photographs, run_in_this_process
from .fakes import BRIGHT, FAR, LEVELS, MISTAKEN, NEAR, OTHER, UNDEFINED, examples

STORED = Path(__file__).parent / "stored"
SEEN = ReconstructionMethod("uoctti-single", UOCTTI, BRIGHT.run, METHODS["uoctti-single"].spec)
Table = TypeVar("Table", Table1, Table2)


class _Outline(HTMLParser):
    """Lines of the rows of tables, headings, what is defined, and numbers and files in texts; what pictures show."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.tag = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tag = tag
        if tag in ("tr", "h2", "dt", "figcaption", "p", "footer"):
            self.lines.append("")
        elif tag == "img":
            self.lines[-1] += f"[{dict(attrs)['alt']}]"

    def handle_data(self, data: str) -> None:
        if data.strip() and self.tag in ("th", "td", "small", "h2", "dt", "figcaption"):
            self.lines[-1] += ("; " if self.tag == "small" else " | ") + " ".join(data.split())
        elif self.tag in ("p", "footer"):
            self.lines[-1] += " ".join(word for word in data.split() if re.search(r"\d|\w\.\w", word))


def outline(page: str) -> str:
    parser = _Outline()
    parser.feed(page.replace(torch.__version__, "").replace(version("nablahog"), ""))
    return "\n".join(parser.lines)


def table1(folder: Path) -> Table1:
    """Of images one of which is no picture and one too small for levels, by methods one of which always fails."""
    some = photographs(3)
    some.images["<b>.png"] = some.images["0.png"][:30].contiguous()
    some.failed["bad,\n.png"] = "no <image>"
    some.ignored.append("notes.txt")
    return _timed(made(folder, some, SEEN, LEVELS, UNDEFINED, MISTAKEN))


def table2(folder: Path) -> Table2:
    """Of four objects, and of three under harder conditions."""
    some = examples([0, 90, 40, 350])
    some.failed["<bad>"] = "no <image>"
    harder = {"sides-5": examples([40, 350], prefix="sides-5/"), "tilted": examples([90], prefix="tilted/")}
    return _timed(run_table2(folder, some, [FAR, NEAR, OTHER], Table2Settings(), harder, workers=1))


def _timed(table: Table) -> Table:
    """As if each result had taken so many seconds as there are before it, and one more."""
    seconds = {name: {each: 1.0 + k for k, each in enumerate(clocks)} for name, clocks in table.seconds.items()}
    return replace(table, seconds=seconds)


def texts() -> dict[str, str]:
    """What the folder of stored tables has, by the names of its files."""
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        run_in_this_process(patch)
        one, two = table1(Path(name, "1")), table2(Path(name, "2"))
        write_table1(Path(name, "1"), one)
        write_table2(Path(name, "2"), two)
        pages = [
            table1_page.page(one, Table1Settings(7, max_evaluations=9), "Images of mine."),
            table2_page.page(two, Table2Settings(7)),
        ]
        terminals = [
            [table1_page.terminal_rows(one)],
            [part(two) for part in (table2_page.terminal_rows, table2_page.terminal_rotations)]
            + [table2_page.terminal_conditions(two)],
        ]
        stored = {}
        for number, page, terminal in zip("12", pages, terminals, strict=True):
            files = sorted(Path(name, number).glob("*.csv"))
            parts = [*(f"{path.name}\n{path.read_text()}" for path in files), outline(page), *map(_lines, terminal)]
            stored[f"table{number}.txt"] = re.sub(r"fakes\.py:\d+", "fakes.py", "\n".join(parts)) + "\n"
        return stored


def _lines(rows: Iterable[Mapping[str, object]]) -> str:
    rows = list(rows)
    lines = [map(figure, line) for line in (rows[0], *(row.values() for row in rows))]
    return "\n" + "\n".join(" ".join(" | ".join(line).split()) for line in lines)


if __name__ == "__main__":
    for name, text in texts().items():
        (STORED / name).write_text(text)
