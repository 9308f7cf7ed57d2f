"""Output on the terminal: tables on stdout, progress on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import Any, Literal, Protocol

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from ..runtime.text import one_line, printable
from ..viz.html import figure, without_empty_columns

UNBROKEN_CHARACTERS = 16  # characters of a name that is not broken in a table
LINE_CHARACTERS = 1000  # characters of a line: lists of file names may be any length
FIRST_LINE, LINE_INTERVAL = 10.0, 60.0  # seconds to the first line of progress without a terminal, and to the next
PIPED_COLUMNS = 120  # columns without a terminal
_quiet = False


def be_quiet(quiet: bool) -> None:
    """Silences tables, lines and progress, or shows them again; errors are always printed."""
    global _quiet
    _quiet = quiet


class Counter(Protocol):
    """Called with the number of items done, their total, and the current item."""

    def __call__(self, done: int, total: int, what: str) -> None: ...


@contextmanager
def counter(name: str, items: str) -> Iterator[Counter]:
    """Shows the progress of many items: a bar on a terminal; elsewhere a line after ten seconds, then every minute.

    ``name`` is that of the command, ``items`` the plural of what it counts.
    """
    console = Console(stderr=True)
    if _quiet:
        yield lambda done, total, what: None
        return
    if not console.is_terminal:
        yield _Lines(name, items)
        return
    done_of_all = (BarColumn(), MofNCompleteColumn(), TextColumn(items))
    columns = (*done_of_all, TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    at_work = TextColumn("{task.description}", markup=False)
    steady = 600  # seconds over which the time left is estimated: items take long, some longer than others
    with Progress(*columns, at_work, console=console, transient=True, speed_estimate_period=steady) as bars:
        task = bars.add_task("", total=None)

        def show(done: int, total: int, what: str) -> None:
            if bars.tasks[0].total is None:  # what an earlier run has done tells nothing of the speed of this one
                bars.reset(task, completed=done, total=total)
            bars.update(task, completed=done, total=total, description=printable(what))

        yield show


class _Lines:
    """A line on stderr after :data:`FIRST_LINE` seconds, then every :data:`LINE_INTERVAL` seconds."""

    def __init__(self, name: str, items: str) -> None:
        self.name, self.items = name, items
        self.began = time.monotonic()
        self.next_line = self.began + FIRST_LINE
        self.before: int | None = None  # done in an earlier run
        self.first: tuple[float, int] | None = None  # when items were done in this run for the first time, and how many

    def __call__(self, done: int, total: int, what: str) -> None:
        now = time.monotonic()
        if self.before is None:
            self.before, self.began = done, now  # what came before the first item does not count
        if self.first is None and done > self.before:
            self.first = now, done
        if now >= self.next_line and self.first is not None:
            self.next_line = now + LINE_INTERVAL
            at_work = f" ({printable(what)})" if what else ""
            left = self._left(now, done, total, *self.first)
            print(f"{self.name}: {done:,} of {total:,} {self.items} done{left}{at_work}", file=sys.stderr)

    def _left(self, now: float, done: int, total: int, first: float, done_first: int) -> str:
        """The time left by the speed since the first items, before which processes start.

        Empty until as much time has passed since then: several processes end their first items nearly at once.
        """
        if done in (done_first, total) or now - first < first - self.began:
            return ""
        return f", {_say_left((now - first) / (done - done_first) * (total - done))} left"


def _say_left(seconds: float) -> str:
    if seconds < 60:
        return "less than a minute"
    return f"about {round(seconds / 60)} min" if seconds < 6000 else f"about {round(seconds / 3600)} hours"


def say(text: str) -> None:
    """Prints a line of at most :data:`LINE_CHARACTERS` characters without markup or wrapping."""
    if not _quiet:
        _console().print(Text(one_line(text, LINE_CHARACTERS)), soft_wrap=True)


def inform(text: str) -> None:
    """Prints a line on stderr that is not an error."""
    if not _quiet:
        print(one_line(text, LINE_CHARACTERS), file=sys.stderr)


def say_page(page: Path) -> None:
    """Points to a page, which has the pictures and says what the figures mean."""
    say(f"Results: {page}")


def say_ignored(ignored: Sequence[str]) -> None:
    """Names the files of a folder that are not images, if any."""
    if ignored:
        say(f"Skipped, because their names do not end like those of images: {', '.join(ignored)}")


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Prints a table with one line for each of ``rows``, which all have the keys of the first.

    A column without any value is left out.
    Texts are broken so that the table fits the terminal, at hyphens and blanks if one column is enough.  Numbers and
    short names stay whole.
    """
    if _quiet:
        return
    console = _console()
    rows = without_empty_columns(rows)
    columns = {key: [_format_value(row[key]) for row in rows] for key in rows[0]}
    numbers = [key for key in columns if all(row[key] is None or isinstance(row[key], int | float) for row in rows)]
    broken = [key for key, shown in columns.items() if key not in numbers and not all(map(_is_short_name, shown))]
    widths = {key: max(map(len, [*key.split("\n"), *shown])) for key, shown in columns.items()}
    room = console.width - sum(widths.values()) - 2 * (len(columns) - 1)
    if room < 0 and len(broken) == 1:
        (key,) = broken
        width = widths[key] + room + len(columns) - 1  # with one blank between columns, not two
        columns[key] = [fill(text, max(width, 1)) for text in columns[key]]
    table = Table(box=SIMPLE_HEAD, padding=(0, int(room >= 0), 0, 0), pad_edge=False, show_edge=False)
    for key in columns:
        justify: Literal["left", "right"] = "right" if key in numbers else "left"
        table.add_column(key, justify=justify, overflow="fold", no_wrap=key not in broken)
    for row in zip(*columns.values(), strict=True):
        table.add_row(*map(Text, row))  # because a file name in brackets is not markup
    console.print(table)


def _is_short_name(text: str) -> bool:
    return len(text) <= UNBROKEN_CHARACTERS and " " not in text


def _format_value(value: object) -> str:
    return printable("x".join(map(str, value)) if isinstance(value, list) else figure(value))


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else PIPED_COLUMNS)
