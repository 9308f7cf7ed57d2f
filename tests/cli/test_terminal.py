"""What the command says besides its results."""

from __future__ import annotations

import pytest

from nablahog.cli import terminal


def test_progress_without_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "EVERY", 60.0)
    times = iter([0.0, 1.0, 30.0, 120.0, 130.0, 300.0])
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(times))
    with terminal.counter("nablahog x") as progress:
        for done in (10, 11, 20, 21, 30):
            progress(done, 50, "a, b")
    assert capsys.readouterr().err.splitlines() == [
        "nablahog x: 20 of 50 done, about 6 min left, at a, b",  # ten took two minutes, the first ten are of before
        "nablahog x: 30 of 50 done, about 5 min left, at a, b",
    ]


def test_tables(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.print_table([{"name": "[red]", "x": None, "size": [1, 2]}, {"name": "b", "x": 0.12345, "size": [3, 4]}])
    terminal.print_definitions({"x": "[bold]"})
    printed = capsys.readouterr().out
    for text in ("[red]", "–", "0.123", "1x2", "x: [bold]"):
        assert text in printed
