"""What the command says besides its results."""

from __future__ import annotations

from functools import partial

import pytest
from rich.console import Console

from nablahog.cli import terminal

NAME = "a\x1b[31m\x9b\u202eb.png"
SHOWN = "a\\x1b[31m\\x9b\\u202eb.png"


def test_progress_without_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "FIRST_LINE", 10.0)
    times = iter([0.0, 1.0, 9.0, 121.0, 130.0, 181.0, 242.0, 303.0, 364.0])
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(times))
    with terminal.counter("nablahog x", "images") as progress:
        for done in (10, 11, 20, 21, 30):
            progress(done, 50, "a, b")
        progress(31, 50, "")
        progress(46, 50, "")
        progress(50, 50, "the page")
    assert capsys.readouterr().err.splitlines() == [
        "nablahog x: 20 of 50 images done, about 6 min left (a, b)",  # ten took two minutes, those before another run
        "nablahog x: 30 of 50 images done, about 3 min left (a, b)",
        "nablahog x: 31 of 50 images done, about 4 min left",
        "nablahog x: 46 of 50 images done, less than a minute left",
        "nablahog x: 50 of 50 images done (the page)",
    ]


@pytest.mark.parametrize(
    ("seconds", "words"), [(59, "less than a minute"), (5999, "about 100 min"), (6000, "about 2 hours")]
)
def test_the_time_left(seconds: float, words: str) -> None:
    assert terminal._say_left(seconds) == words


def test_the_start_of_processes_tells_nothing_of_the_time_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two processes take 30 s to start, then 10 s for ten images each."""
    monkeypatch.setattr(terminal, "FIRST_LINE", 10.0)
    times = iter([0.0, 0.0, 40.0, 41.0, *(time for k in range(5, 13) for time in (10.0 * k, 10.0 * k + 1))])
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(times))
    with terminal.counter("nablahog x", "images") as progress:
        for done in range(0, 190, 10):
            progress(done, 2000, "")
    assert capsys.readouterr().err.splitlines() == [
        "nablahog x: 10 of 2,000 images done",
        "nablahog x: 130 of 2,000 images done, about 16 min left",  # 187 pairs of ten images
    ]


def test_names_do_not_command_the_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    terminal.say(f"Skipped: {NAME}")
    terminal.print_table([{"input": NAME, "size": [1, 2]}])
    printed = capsys.readouterr()
    assert printed.out.count(SHOWN) == 2
    assert printed.out.replace("\n", "").isprintable()
    monkeypatch.setattr(terminal, "Console", partial(Console, force_terminal=True, width=100))
    with terminal.counter("x", "images") as progress:
        progress(1, 2, NAME)
    printed = capsys.readouterr()
    assert SHOWN in printed.err
    assert "\x1b[31m\x9b" not in printed.err
    assert printed.err.endswith("\x1b[2K")  # the bar is wiped out in the end


def test_wide_tables_fit_a_narrow_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Table 1 is the widest; its numbers stay whole, and names are broken at hyphens."""
    monkeypatch.setattr(terminal, "PIPED_COLUMNS", 80)
    headings = ("CC", "CC\npaper", "|CC|", "MI", "MI\npaper", "SSIM", "SSIM\npaper", "distance", "seconds")
    row = {"method": "paper-dalal-multi-scale-more", "n": 101, **dict.fromkeys(headings, -0.12345)}
    terminal.print_table([row, {**row, "method": "  @1/64"}, {**row, "method": "uoctti-single"}])
    terminal.print_table([{"input": "/a/long/path/of/a/photograph/of/a/cat.png", "CC": 0.5, "output": "x" * 90}])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(line.count("-0.123") for line in lines) == 3 * len(headings)
    names = [line[:11].rstrip() for line in lines]
    at = names.index("paper-")
    assert names[at : at + 4] == ["paper-", "dalal-", "multi-", "scale-more"]
