"""The size of the command: its options, and its help."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import pytest

from nablahog.cli.main import main, parser

MOST_OPTIONS = 110  # of all commands
MOST_LINES = 40  # of the help of one


def _commands(above: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield above
    for action in above._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _commands(below)


def test_options_are_few_and_help_fits_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    options, long = 0, {}
    for command in _commands(parser()):
        shown = [each for each in command._actions if each.option_strings and each.dest != "help"]
        options += len(shown)
        lines = command.format_help().count("\n")
        if lines > MOST_LINES:
            long[command.prog] = lines
    assert options <= MOST_OPTIONS
    assert not long


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("nablahog 0")
    for command in ([], ["hog"], ["invert"], ["learn", "prior"]):
        assert main([*command, "--help"]) == 0
        assert "usage: nablahog" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "meant"),
    [
        (["invrt", "a.png"], "'invert'"),
        (["learn", "priors", "-o", "p.npz"], "'prior'"),
        (["invert", "a.png", "-o", "d", "--qualty", "fast"], "'--quality'"),
        (["table1", "-o", "t", "--methods", "uocti-single"], "'uoctti-single'"),
        (["hog", "a.png", "-o", "d", "--set", "orientation=8", "--preset", "skimage"], "'orientations'"),
    ],
)
def test_did_you_mean(argv: list[str], meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) in (1, 2)
    error = capsys.readouterr().err
    assert f"; did you mean {meant}?" in error
    assert error.count("\n") == 1
