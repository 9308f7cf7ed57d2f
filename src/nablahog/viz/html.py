"""Figures, pictures and drawings as one self-contained HTML page."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from ..io.images import Picture, to_pil
from .pictures import Panel

if TYPE_CHECKING:
    import jinja2

COLOURS = {  # by name: in light mode and in dark mode
    "ground": ("#ffffff", "#15171a"),  # of pages
    "text": ("#282828", "#e4e6e8"),
    "grid": ("#e1e1e1", "#33383e"),
    "faint": ("#707070", "#8f979f"),
    "curve": ("#184a96", "#7cb0ff"),
    "path": ("#a85b00", "#f0a24a"),
    "mark": ("#d9170c", "#ff6b61"),
}
LONG_TEXT = 40  # characters above which a text in a table gets a wide column


@cache
def _load_template(name: str) -> jinja2.Template:
    """A template that escapes all that is inserted, and raises for undefined names."""
    import jinja2  # few commands need it
    import markupsafe

    loader, undefined = jinja2.PackageLoader("nablahog.viz"), jinja2.StrictUndefined
    environment = jinja2.Environment(loader=loader, undefined=undefined, autoescape=True, trim_blocks=True)
    environment.filters |= {
        "png": png,
        "text": lambda name: markupsafe.Markup(_read_text(name)),
        "inner": _inner,
        "figure": figure,
        "table": _table,
        "sortable": _key,
    }
    environment.tests |= {
        "cell": lambda value: isinstance(value, Cell),
        "panel": lambda value: isinstance(value, Panel),
        "long": lambda value: isinstance(value, str) and len(value) > LONG_TEXT,
    }
    return environment.get_template(name)


TEMPLATES = Path(__file__).with_name("templates")


@cache
def _read_text(name: str) -> str:
    """A style sheet or script, as it is."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


def png(picture: Picture) -> str:
    """A picture, as :func:`~nablahog.io.images.to_pil` takes it, as the text of a PNG in base64."""
    buffer = io.BytesIO()
    to_pil(picture).save(buffer, format="PNG")
    return base64.b64encode(buffer.getvalue()).decode("ascii")


Point = tuple[float, float]


@dataclass(frozen=True)
class Shape:
    """A line through ``points``, or a dot, text or image at its one point, which is the upper left corner of an image.

    ``width`` is also the radius of a dot or side of an image, whose ``text`` is its PNG in base64.  ``anchor`` is
    "start", "middle" or "end".  Colours are keys of :data:`COLOURS`.
    """

    kind: str
    points: Sequence[Point]
    colour: str = "text"
    width: float = 1.0
    text: str = ""
    fill: str = "ground"
    anchor: str = "start"

    @property
    def coordinates(self) -> str:
        """The points as SVG has them."""
        return " ".join(f"{round(x, 2)},{round(y, 2)}" for x, y in self.points)


@dataclass
class Drawing:
    """A drawing in pixels, y downwards, to which shapes are added from the back to the front.

    Its title and description are for those who cannot see it.
    """

    width: int
    height: int
    title: str
    description: str
    shapes: list[Shape] = field(default_factory=list)

    def line(self, points: Sequence[Point], colour: str, width: float = 1.0) -> None:
        """Adds a line through points."""
        self.shapes.append(Shape("line", points, colour, width))

    def dot(self, place: Point, colour: str, radius: float, *, ringed: bool = False) -> None:
        """Adds a dot, or a ring."""
        self.shapes.append(Shape("dot", [place], colour, radius, fill="ground" if ringed else colour))

    def note(self, place: Point, text: str, colour: str = "text", anchor: str = "start") -> None:
        """Adds a text, whose base line is at the place."""
        self.shapes.append(Shape("text", [place], colour, text=text, anchor=anchor))

    def image(self, corner: Point, side: float, picture: Picture) -> None:
        """Adds a square picture by its upper left corner."""
        self.shapes.append(Shape("image", [corner], width=side, text=png(picture)))

    def svg(self) -> str:
        """The text of the SVG: a file, or a part of a page."""
        return _load_template("drawing.svg").render(drawing=self, colours=COLOURS)


@dataclass(frozen=True)
class Cell:
    """A figure of a table, or a :class:`Panel`, with a smaller remark below it; ``link`` is a page that it leads to."""

    value: object
    remark: str = ""
    link: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, a sentence, and below them pictures, a table or charts.

    Attributes:
        heading: may be empty.
        text: the sentence.
        panels: pictures side by side.
        wide: whether at most two of them are side by side.
        table: as :func:`page` takes it.
        compared: two pictures of one shape, one above the other, with a slider that wipes from the first to the second.
        drawings: charts side by side, if there is room.
    """

    heading: str
    text: str
    panels: Sequence[Panel] = ()
    wide: bool = field(default=False, kw_only=True)
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
    """A figure as text: three decimals, or one from 10 on; an en dash for None; anything else as it is."""
    if isinstance(value, Shown):
        return value.text
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def without_empty_columns(rows: Sequence[Mapping[str, object]]) -> list[dict[str, object]]:
    """A table without the columns in which all values are None."""
    filled = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    return [{name: row[name] for name in filled} for row in rows]


def page(
    title: str,
    lead: str,
    table: Sequence[Mapping[str, object]],
    sections: Sequence[Section],
    definitions: Mapping[str, str],
    footer: str = "",
    *,
    first: Section | None = None,
    caption: str = "The figures are explained at the end.",
    back: tuple[str, str] | None = None,
) -> str:
    """One HTML page in one file: pictures are inlined, styles follow light and dark mode.

    Its tables can be sorted by a click on a heading, within the groups of their rows.

    Args:
        title, lead, footer: plain text; all text is escaped.
        table: one mapping for each row, all with the keys of the first, which head the columns.  A value may be a
            :class:`Cell` or a :class:`Panel`.  A mapping with a single key is a heading across the table.
        sections: sections after the table; those with neither pictures nor table are left out.
        definitions: what each figure means, printed at the end.
        first: a section above the table.
        caption: the caption of the table.
        back: the file of the page that leads here, and what it is called.
    """
    return _load_template("page.html").render(
        title=title,
        lead=lead,
        rows=table,
        caption=caption,
        sections=[part for part in sections if part.panels or part.table or part.compared or part.drawings],
        definitions=definitions,
        footer=footer,
        first=first,
        back=back,
    )


def footer(figures: str, settings: str = "") -> str:
    """The versions that made a page, the settings of the run, as ", seed 0", and the files that have its figures."""
    versions = f"Made by nablahog {version('nablahog')} with PyTorch {torch.__version__}{settings}."
    return f"{versions} All figures, with their full precision, are in {figures}."


@dataclass(frozen=True)
class _Table:
    """Whether each column holds numbers, and the rows in groups, each with its heading or None."""

    caption: str
    columns: dict[str, bool]
    groups: list[tuple[str | None, list[Mapping[str, object]]]]
    grid: bool


def _table(rows: Sequence[Mapping[str, object]], caption: str) -> _Table:
    names = max(rows, key=len).keys()
    whole = [row for row in rows if len(row) == len(names)]
    columns = {name: all(isinstance(_inner(row[name]), int | float | None) for row in whole) for name in names}
    groups: list[tuple[str | None, list[Mapping[str, object]]]] = [(None, [])]
    for row in rows:
        if len(row) == len(names):
            groups[-1][1].append(row)
        else:
            groups.append((figure(*row.values()), []))
    grid = any(isinstance(_inner(value), Panel) for row in whole for value in row.values())
    return _Table(caption, columns, [group for group in groups if any(group)], grid)


def _inner(value: object) -> object:
    return value.value if isinstance(value, Cell) else value


def _key(value: float | None) -> str:
    """The text by which a figure is sorted: empty, and so the last, for none and for what is not finite."""
    return repr(value) if value is not None and math.isfinite(value) else ""
