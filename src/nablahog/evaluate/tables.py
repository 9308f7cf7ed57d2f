"""Parts of both tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..io.files import replacing


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
    with replacing(path) as file:
        file.write(text.getvalue().encode(errors="backslashreplace"))
