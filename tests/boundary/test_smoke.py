"""Two cells of the table: an input that means what another does, and one that means nothing."""

from __future__ import annotations

from .columns import COLUMNS
from .rows import ROWS
from .table import run_cell


def test_cells() -> None:
    assert run_cell(ROWS["array float64"], COLUMNS["hog"]).state == "equal"
    assert run_cell(ROWS["array of strings"], COLUMNS["hog"]).state == "refused"
