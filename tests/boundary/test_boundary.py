"""Each cell of the table is equal to the plain result or refused with a remedy, but for those in ``known.txt``."""

from __future__ import annotations

import numpy as np
import pytest

import nablahog

from .columns import COLUMNS
from .columns.plain import DESCRIPTOR, SIZE
from .known import known_failures
from .rows import ROWS
from .table import Column, Row, Use, numbers, plain_result, run_cell

KNOWN = known_failures()


@pytest.mark.parametrize("row", ROWS.values(), ids=lambda row: row.name)
def test_row(row: Row) -> None:
    cells = {name: run_cell(row, column) for name, column in COLUMNS.items() if column.takes(row)}
    assert cells, "no column takes this kind"
    failing = {name: cell for name, cell in cells.items() if cell.state == "failing"}
    new = [f"{name}: {cell.detail} {cell.where}" for name, cell in failing.items() if (row.name, name) not in KNOWN]
    assert not new, "\n".join(new)
    repaired = [name for name in cells if (row.name, name) in KNOWN and name not in failing]
    assert not repaired, f"repaired, so delete the row from known.txt: {', '.join(repaired)}"


def test_known_failures_are_cells() -> None:
    assert not [cell for cell in KNOWN if cell[0] not in ROWS or cell[1] not in COLUMNS]


def test_every_column_has_a_plain_result() -> None:
    """And kinds of rows and columns are the same."""
    kinds = {kind for column in COLUMNS.values() for kind in column.uses}
    assert kinds | {"context"} == {row.kind for row in ROWS.values()}


def test_command_and_page_give_the_results_of_python() -> None:
    pose = plain_result("estimate_pose", "box")
    preimage = nablahog.reconstruct(DESCRIPTOR[:1], "uoctti", SIZE, quality="fast", prior=None, seed=3).image
    for kind, names, expected, off in (
        ("box", ("nablahog pose", "page /api/pose"), pose, 0.05),
        ("number", ("nablahog invert", "page /api/invert"), preimage, 0.01),
    ):
        for name in names:
            result = numbers(plain_result(name, kind))  # type: ignore[arg-type]
            np.testing.assert_allclose(result, numbers(expected), atol=off, rtol=0, err_msg=name)


def _refusing(value: float) -> float:
    if value != 1:
        raise ValueError("expected 1")  # not by the package
    return value


@pytest.mark.parametrize(
    ("value", "must", "state"),
    [
        (1, "either", "equal"),
        (2, "either", "failing"),
        (1, "be refused", "failing"),
        (np.float32(1), "be taken", "equal"),
    ],
)
def test_the_table_can_fail(value: object, must: str, state: str, monkeypatch: pytest.MonkeyPatch) -> None:
    column = Column("one", {"number": Use(_refusing, 1)})  # type: ignore[arg-type]
    monkeypatch.setitem(COLUMNS, "one", column)
    row = Row("a row", "number", lambda _: value, must=must)  # type: ignore[arg-type]
    assert run_cell(row, column).state == state
