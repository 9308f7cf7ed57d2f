"""Tables and figures as Markdown."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from timing import Summary, digits


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Columns of figures are aligned to the right, all others to the left."""
    body = [list(row) for row in rows]
    figures = ([all(re.match(r"[\d≥≤–*-]", cell) for cell in column) for column in zip(*body, strict=True)] or [])[1:]
    lines = [head, ["---", *("---:" if each else "---" for each in figures)], *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def times(stats: Summary, spread: bool = True) -> str:
    """A ratio, bold where the peer is the faster one."""
    text = f"{digits(stats['median'])}×"
    shown = f"**{text}**" if stats["median"] < 1 else text
    return f"{shown} ({digits(stats['q1'])}…{digits(stats['q3'])})" if spread else shown


def times_each(ratios: Mapping[str, Summary]) -> str:
    """All ratios with their peers."""
    return ", ".join(f"{times(stats)} {peer}" for peer, stats in ratios.items()) or "–"


def shape(point: Mapping[str, Any]) -> str:
    return f"{point['batch']}×{point['side']}²" if point["batch"] > 1 else f"{point['side']}²"


def where_there(value: Any, show: Callable[[Any], str]) -> str:
    return "–" if value is None else show(value)


def shares(of_each: Mapping[str, Mapping[str, float]]) -> str:
    """What the time of each is spent on, in words."""
    named = ({f"`{k}`" if k != "other" else k: v for k, v in of.items()} for of in of_each.values())
    said = (", ".join(f"{part} {100 * share:.0f} %" for part, share in of.items()) for of in named)
    return "; ".join(f"*{name}*: {text}" for name, text in zip(of_each, said, strict=True))
