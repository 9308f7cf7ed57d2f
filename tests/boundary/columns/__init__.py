"""Entry points, each a column of the table; a new one is one line."""

from __future__ import annotations

from ..table import Column
from . import describing, fitting, front_ends, inverting, parts

COLUMNS: dict[str, Column] = {
    column.name: column for part in (describing, inverting, fitting, parts, front_ends) for column in part.COLUMNS
}
