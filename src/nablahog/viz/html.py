"""Figures and pictures as one self-contained HTML page."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version

import torch

from ..io.images import to_pil
from .pictures import Panel

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; --line: color-mix(in srgb, currentColor 22%, transparent); }}
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }}
h1 {{ line-height: 1.2; }}
h2 {{ margin-top: 2.5rem; }}
.table {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; }}
th, td {{ border-bottom: 1px solid var(--line); padding: .35rem 1.2rem .35rem 0; text-align: left; }}
td {{ vertical-align: top; }}
td:first-child {{ white-space: nowrap; }}
th.number, td.number {{ text-align: right; }}
.pictures {{ display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr)); }}
figure {{ margin: 0; }}
img {{ width: 100%; height: auto; display: block; }}
th {{ vertical-align: bottom; }}
th[colspan] {{ padding-top: 1.2rem; }}
td small {{ display: block; opacity: .7; font-size: .72rem; line-height: 1.3; white-space: pre; }}
table.grid {{ table-layout: fixed; }}
.grid th, .grid td {{ border: 0; padding: .2rem .4rem .4rem 0; font-size: .9rem; overflow-wrap: break-word; }}
.grid small {{ white-space: pre-line; }}
figcaption, dl, footer {{ font-size: .9rem; opacity: .85; }}
dt {{ font-weight: 600; }}
dd {{ margin: 0 0 .6rem; }}
footer {{ border-top: 1px solid var(--line); margin-top: 3rem; padding-top: 1rem; }}
</style>
</head>
<body>
<h1>{title}</h1>
<p>{lead}</p>
{table}
{sections}
<h2>What the figures mean</h2>
<dl>
{definitions}
</dl>
<footer>{footer}</footer>
</body>
</html>
"""


GRID = 6.8  # width of the columns of a table of pictures, in the page's rem: ten fit


@dataclass(frozen=True)
class Cell:
    """A figure of a table, or a :class:`Panel`, with a smaller remark below it."""

    value: object
    remark: str


@dataclass(frozen=True)
class Section:
    """A heading, a sentence, and below them pictures side by side, or a table as :func:`page` takes it."""

    heading: str
    text: str
    panels: Sequence[Panel] = ()
    table: Sequence[Mapping[str, object]] = ()


def figure(value: object) -> str:
    """A figure as people read it: three decimals, one from 10 on, an en dash for None, anything else as it is."""
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
) -> str:
    """One HTML page that needs nothing but itself: pictures are inlined, styles follow light and dark mode.

    Args:
        title, lead, footer: plain text; all text is escaped.
        table: one mapping for each row, all with the keys of the first, which head the columns.  A value may be a
            :class:`Cell` or a :class:`Panel`.  A mapping with a single key is a heading across the table.
        sections: what follows the table; those without pictures and table are left out.
        definitions: what each figure means, printed under the table's figures.
    """
    return _PAGE.format(
        title=escape(title),
        lead=escape(lead),
        table=_table(table),
        sections="\n".join(_section(section) for section in sections if section.panels or section.table),
        definitions="\n".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in definitions.items()),
        footer=escape(footer),
    )


def footer(figures: str, settings: str = "") -> str:
    """What a page was made with, and where its figures are with their full precision.

    Args:
        figures: the files, to end the sentence.
        settings: of the run, to follow the versions, as ", seed 0".
    """
    made = f"Made by nablahog {version('nablahog')} with PyTorch {torch.__version__}{settings}."
    return f"{made} All figures, with their full precision, are in {figures}."


def _table(rows: Sequence[Mapping[str, object]]) -> str:
    if not rows:
        return ""
    columns = max(rows, key=len).keys()
    whole = [row for row in rows if len(row) == len(columns)]
    numeric = {key: all(isinstance(_value(row[key]), int | float | None) for row in whole) for key in columns}
    grid = any(isinstance(_value(value), Panel) for row in whole for value in row.values())
    style = f' class="grid" style="width: {GRID * len(columns)}rem"' if grid else ""

    def line(row: Mapping[str, object]) -> str:
        if len(row) < len(columns):
            return f'<tr><th colspan="{len(columns)}">{escape(figure(*row.values()))}</th></tr>'
        return f"<tr>{''.join(_cell(row[key], numeric[key]) for key in columns)}</tr>"

    head = "".join(f"<th{' class=number' if numeric[key] else ''}>{escape(key)}</th>" for key in columns)
    body = "\n".join(line(row) for row in rows)
    table = f"<table{style}>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"
    return f'<div class="table">{table}</div>'


def _value(value: object) -> object:
    return value.value if isinstance(value, Cell) else value


def _cell(value: object, numeric: bool) -> str:
    inner = _value(value)
    shown = _image(inner) if isinstance(inner, Panel) else escape(figure(inner))
    remark = f"<small>{escape(value.remark)}</small>" if isinstance(value, Cell) else ""
    return f"<td{' class=number' if numeric else ''}>{shown}{remark}</td>"


def _section(section: Section) -> str:
    figures = "\n".join(
        f"<figure>{_image(panel)}<figcaption>{escape(panel.caption)}</figcaption></figure>" for panel in section.panels
    )
    pictures = f'\n<div class="pictures">\n{figures}\n</div>' if figures else ""
    return f"<h2>{escape(section.heading)}</h2>\n<p>{escape(section.text)}</p>{pictures}\n{_table(section.table)}"


def _image(panel: Panel) -> str:
    buffer = io.BytesIO()
    to_pil(panel.picture).save(buffer, format="PNG", optimize=True)
    png = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img src="data:image/png;base64,{png}" alt="{escape(panel.caption)}">'
