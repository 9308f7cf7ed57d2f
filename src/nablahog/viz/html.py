"""Figures and pictures as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING

import torch

from .environment import environment, png
from .pictures import Panel
from .svg import Drawing

if TYPE_CHECKING:
    import jinja2

LONG = 40  # characters above which a text in a table gets a wide column
GRID = 6.8  # rem, the width of a column of pictures: ten fit on the page


@dataclass(frozen=True)
class Cell:
    """A figure of a table, or a :class:`Panel`, with a smaller remark below it."""

    value: object
    remark: str


@dataclass(frozen=True)
class Section:
    """A heading, a sentence, and below them pictures, a table or charts.

    Attributes:
        heading: may be empty.
        text: the sentence.
        panels: pictures side by side.
        table: as :func:`page` takes it.
        compared: two pictures of one shape, one above the other, with a slider that wipes from the first to the second.
        drawings: charts side by side, if there is room.
    """

    heading: str
    text: str
    panels: Sequence[Panel] = ()
    table: Sequence[Mapping[str, object]] = ()
    compared: tuple[Panel, Panel] | None = None
    drawings: Sequence[Drawing] = ()


class Shown(float):
    """A figure that is shown as a text of its own; tables are sorted by its value."""

    text: str

    def __new__(cls, value: float, text: str) -> Shown:
        shown = super().__new__(cls, value)
        shown.text = text
        return shown


def figure(value: object) -> str:
    """A figure as people read it: three decimals, one from 10 on, an en dash for None, anything else as it is."""
    if isinstance(value, Shown):
        return value.text
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def page(
    title: str,
    lead: str,
    table: Sequence[Mapping[str, object]],
    sections: Sequence[Section],
    definitions: Mapping[str, str],
    footer: str = "",
    *,
    first: Section | None = None,
    caption: str = "What the figures mean is said at the end.",
) -> str:
    """One HTML page that needs nothing but itself: pictures are inlined, styles follow light and dark mode.

    Its tables can be sorted by a click on a heading, within the groups of their rows.

    Args:
        title, lead, footer: plain text; all text is escaped.
        table: one mapping for each row, all with the keys of the first, which head the columns.  A value may be a
            :class:`Cell` or a :class:`Panel`.  A mapping with a single key is a heading across the table.
        sections: what follows the table; those with neither pictures nor table are left out.
        definitions: what each figure means, printed at the end.
        first: a section above the table.
        caption: of the table.
    """
    return _template().render(
        title=title,
        lead=lead,
        rows=table,
        caption=caption,
        sections=[each for each in sections if each.panels or each.table or each.compared or each.drawings],
        definitions=definitions,
        footer=footer,
        first=first,
    )


def made(settings: str = "") -> str:
    """The versions that made a page, and then the ``settings`` of the run, such as ", seed 0"."""
    return f"Made by nablahog {version('nablahog')} with PyTorch {torch.__version__}{settings}."


def footer(figures: str, settings: str = "") -> str:
    """The versions that made a page, and the files that have its figures with their full precision.

    Args:
        figures: the files, to end the sentence.
        settings: of the run, to follow the versions, as ", seed 0".
    """
    return f"{made(settings)} All figures, with their full precision, are in {figures}."


@cache
def _template() -> jinja2.Template:
    pages = environment().overlay()
    pages.filters = {**pages.filters, "png": png, "inner": _inner, "figure": figure, "table": _table, "sortable": _key}
    tests: dict[str, Callable[[object], bool]] = {
        "cell": lambda value: isinstance(value, Cell),
        "panel": lambda value: isinstance(value, Panel),
        "long": lambda value: isinstance(value, str) and len(value) > LONG,
    }
    pages.tests = {**pages.tests, **tests}
    return pages.get_template("page.html")


@dataclass(frozen=True)
class _Column:
    name: str
    numeric: bool


@dataclass(frozen=True)
class _Group:
    """Rows below a heading, which is None where there is none."""

    heading: str | None
    rows: list[Mapping[str, object]]


@dataclass(frozen=True)
class _Table:
    caption: str
    columns: list[_Column]
    groups: list[_Group]
    grid: bool

    @property
    def width(self) -> float:
        return GRID * len(self.columns)


def _table(rows: Sequence[Mapping[str, object]], caption: str) -> _Table:
    names = max(rows, key=len).keys()
    whole = [row for row in rows if len(row) == len(names)]
    columns = [_Column(name, all(isinstance(_inner(row[name]), int | float | None) for row in whole)) for name in names]
    groups = [_Group(None, [])]
    for row in rows:
        if len(row) == len(names):
            groups[-1].rows.append(row)
        else:
            groups.append(_Group(figure(*row.values()), []))
    grid = any(isinstance(_inner(value), Panel) for row in whole for value in row.values())
    return _Table(caption, columns, [group for group in groups if group.heading is not None or group.rows], grid)


def _inner(value: object) -> object:
    return value.value if isinstance(value, Cell) else value


def _key(value: float | None) -> str:
    """The text by which a figure is sorted: empty, and so the last, for none and for what is not finite."""
    return repr(value) if value is not None and math.isfinite(value) else ""
