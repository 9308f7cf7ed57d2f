"""Each cell of the table is equal to the plain result or refused with a remedy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import nablahog

from .columns import COLUMNS
from .columns.plain import DESCRIPTOR, IMAGE, OTHER, SIZE
from .rows import ROWS
from .table import Column, Row, Use, numbers, plain_result, run_cell

SLOW = ("angle", "context", "number", "size")  # kinds of rows that searches take
XSLOW = {  # much like others of their kinds
    *("decimal context", "default dtype float64", "in a thread", "no standard output", "set_grad_enabled(False)"),
    *("twice", "two threads of PyTorch", "number array ()", "number np.int32", "number np.uint16"),
    *("size array int32", "size array uint8", "size np.int64 alone", "size tensors"),
}


def _marks(name: str, row: Row) -> list[pytest.MarkDecorator]:
    return [pytest.mark.xslow] * (name in XSLOW) + [pytest.mark.slow] * (row.kind in SLOW)


PARAMETERS = [pytest.param(row, id=name, marks=_marks(name, row)) for name, row in ROWS.items()]
assert not XSLOW - {*ROWS}


@pytest.mark.parametrize("row", PARAMETERS)
def test_row(row: Row) -> None:
    cells = {name: run_cell(row, column) for name, column in COLUMNS.items() if column.takes(row)}
    assert cells, "no column takes this kind"
    failing = [f"{name}: {cell.detail} {cell.where}" for name, cell in cells.items() if cell.state == "failing"]
    assert not failing, "\n".join(failing)


def test_every_column_has_a_plain_result() -> None:
    """And kinds of rows and columns are the same."""
    kinds = {kind for column in COLUMNS.values() for kind in column.uses}
    assert kinds | {"context"} == {row.kind for row in ROWS.values()}


@pytest.mark.slow
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


def test_arrays_are_described_inside_transforms() -> None:
    expected = nablahog.hog(IMAGE, "uoctti")

    def distance(x: torch.Tensor) -> torch.Tensor:
        return (nablahog.hog(x, "uoctti") - torch.from_numpy(nablahog.hog(IMAGE, "uoctti"))).square().sum()

    _, value = torch.func.grad_and_value(distance)(torch.from_numpy(OTHER)[None, None])
    other = nablahog.hog(OTHER, "uoctti")
    assert float(value) == pytest.approx(float(np.square(other - expected).sum()), rel=1e-5)


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
