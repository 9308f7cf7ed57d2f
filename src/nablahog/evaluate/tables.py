"""Parts of both tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..io.files import write_text
from ..viz.html import Section


@dataclass(frozen=True)
class Failure:
    """An image without a result of a method (None: of every method), and one sentence why."""

    image: str
    method: str | None
    reason: str


def evenly_spread(names: Sequence[str], count: int) -> list[str]:
    """At most ``count`` of ``names``, evenly spread over all."""
    count = min(count, len(names))
    return [names[i * len(names) // count] for i in range(count)]


def write_csv(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Writes a table whole or not at all: full precision, nothing where there is None, the heads in the first row."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())


def failures_section(failures: Sequence[Failure], image: str, text: str) -> Section | None:
    """A section that lists the failures; None if there are none.

    Args:
        failures: of the run.
        image: the heading of their images.
        text: what they mean for the figures.
    """
    if not failures:
        return None
    rows = [{image: each.image, "method": each.method or "all", "reason": each.reason} for each in failures]
    return Section(f"Failed: {len(rows)}", text, table=rows)
