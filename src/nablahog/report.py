"""Figures and pictures as one self-contained HTML page."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from .draw import Panel
from .images import to_pil

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
th.number, td.number {{ text-align: right; }}
.pictures {{ display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr)); }}
figure {{ margin: 0; }}
figure img {{ width: 100%; height: auto; display: block; }}
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


@dataclass(frozen=True)
class Section:
    """A heading, a sentence, and pictures side by side."""

    heading: str
    text: str
    panels: Sequence[Panel]


def figure(value: object) -> str:
    """A figure as people read it: three decimals, an en dash for None, anything else as it is."""
    if value is None:
        return "–"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


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
        table: one mapping for each row, all with the keys of the first, which head the columns.
        sections: the pictures.
        definitions: what each figure means, printed under the table's figures.
    """
    return _PAGE.format(
        title=escape(title),
        lead=escape(lead),
        table=_table(table),
        sections="\n".join(_section(section) for section in sections),
        definitions="\n".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in definitions.items()),
        footer=escape(footer),
    )


def _table(rows: Sequence[Mapping[str, object]]) -> str:
    if not rows:
        return ""
    numeric = {key: all(isinstance(row[key], int | float | None) for row in rows) for key in rows[0]}

    def cells(tag: str, texts: Mapping[str, str]) -> str:
        return "".join(
            f"<{tag}{' class=number' if numeric[key] else ''}>{escape(texts[key])}</{tag}>" for key in numeric
        )

    head = cells("th", {key: key for key in numeric})
    body = "\n".join(f"<tr>{cells('td', {key: figure(row[key]) for key in numeric})}</tr>" for row in rows)
    return f'<div class="table"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>'


def _section(section: Section) -> str:
    figures = "\n".join(
        f'<figure><img src="data:image/png;base64,{_png(panel)}" alt="{escape(panel.caption)}">'
        f"<figcaption>{escape(panel.caption)}</figcaption></figure>"
        for panel in section.panels
    )
    heading, text = escape(section.heading), escape(section.text)
    return f'<h2>{heading}</h2>\n<p>{text}</p>\n<div class="pictures">\n{figures}\n</div>'


def _png(panel: Panel) -> str:
    buffer = io.BytesIO()
    to_pil(panel.picture).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode("ascii")
