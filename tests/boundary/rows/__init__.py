"""Kinds of input, each a row of the table; a new one is one line."""

from __future__ import annotations

from ..table import Row
from . import arrays, contexts, images, tensors, things, values

ROWS: dict[str, Row] = {
    row.name: row for part in (arrays, tensors, images, things, values, contexts) for row in part.ROWS
}
