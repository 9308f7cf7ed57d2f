"""The command as a whole: few options, its help, completion in the shell, and advice that names its options."""

from __future__ import annotations

import argparse
import ast
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import nablahog
from nablahog.cli.arguments.options import Parser
from nablahog.cli.errors import OPTIONS, WrongArguments, blaming_arguments, name_options
from nablahog.cli.main import main, parser
from nablahog.render.mesh import axes
from nablahog.requests.dialect import PRESETS, preset_parameters
from nablahog.runtime.errors import InputError

MOST_OPTIONS = 110  # of all commands
MOST_LINES = 44  # of the help of one


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
        (["hog", "a.png", "-o", "d", "--cell-size", "4"], "'--set cell_size=…'"),
        (["table1", "-o", "t", "--methods", "uocti-single"], "'uoctti-single'"),
        (["hog", "a.png", "-o", "d", "--set", "orientation=8", "--preset", "skimage"], "'orientations'"),
    ],
)
def test_did_you_mean(argv: list[str], meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) in (1, 2)
    error = capsys.readouterr().err
    assert f"; did you mean {meant}?" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("nablahog inv", {"invert"}),
        ("nablahog hog --preset op", {"opencv"}),
        ("nablahog learn p", {"prior"}),
        ("nablahog invert a.png --quality ", {"best", "fast"}),
    ],
)
def test_words_are_completed(line: str, expected: set[str]) -> None:
    """As argcomplete's shell function asks for them."""
    pytest.importorskip("argcomplete")
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    command = ["sh", "-c", f"exec {sys.executable} -m nablahog 8>&1 9>/dev/null"]
    ended = subprocess.run(command, env={**os.environ, **asked}, capture_output=True, text=True)
    assert {word.strip() for word in ended.stdout.split("\n")} == expected


def test_the_command_says_that_it_can() -> None:
    """Global completion looks for this mark in the first kilobyte of the entry point."""
    assert "PYTHON_ARGCOMPLETE_OK" in Path(nablahog.__file__).with_name("__main__.py").read_text()[:1024]


PACKAGE = Path(nablahog.__file__).parent
COMMANDS = parser()._subparsers._group_actions[0].choices  # type: ignore[union-attr]
REACHED = {"pose": ("pose",), "render": ("pose",), "invert": ("invert",), "inputs": ("pose", "invert"), "io": COMMANDS}
"""Which commands may show the errors of a room."""
PARAMETERS = {name for preset in PRESETS for name in preset_parameters(preset)}
KEYWORDS = {
    name
    for function in (nablahog.reconstruct, nablahog.estimate_pose, nablahog.load_mesh, nablahog.render)
    for name in inspect.signature(function).parameters
}


def flags(command: str) -> set[str]:
    found: Parser = COMMANDS[command]  # type: ignore[assignment]
    return {*found._option_string_actions}


def sentences(folder: Path) -> Iterator[tuple[str, str]]:
    """Of all errors that are raised in a folder: file and line, and the words of the sentence."""
    files = sorted(folder.rglob("*.py"))
    assert files, f"{folder} is elsewhere"
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise):
                texts = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
                yield f"{file.name}:{node.lineno}", "".join(text for text in texts if isinstance(text, str))


@pytest.mark.parametrize("room", REACHED)
def test_arguments_in_errors_of_the_library_are_options(room: str) -> None:
    for place, sentence in sentences(PACKAGE / room):
        named = re.findall(r"`(\w+)`", sentence)
        for command in REACHED[room] if named else ():
            if room != "inputs" or {*map(OPTIONS.get, named)} <= flags(command):
                assert {OPTIONS[name] for name in named} <= flags(command), f"{place}: {sentence}"
        assert not {*re.findall(r"\b(\w+)=", sentence)} & (KEYWORDS - PARAMETERS), f"{place}: {sentence}"


@pytest.mark.parametrize("command", ["pose", "invert", "hog", "glyph"])
def test_options_in_errors_of_a_command_are_its_own(command: str) -> None:
    module = {"glyph": "hog"}.get(command, command)
    own = [each for each in sentences(PACKAGE / "cli" / "commands") if each[0].startswith(f"{module}.py")]
    assert own
    for place, sentence in own:
        assert {*re.findall(r"--[a-z][a-z-]+", sentence)} <= flags(command), f"{place}: {sentence}"


def test_a_sentence_of_the_library_is_worded_with_options() -> None:
    with pytest.raises(ValueError, match="give `front`, too") as refusal:
        axes("x")
    assert "give --front, too" in name_options(str(refusal.value))
    assert name_options("`initial` and `nothing`") == "--init and nothing"


def test_faults_of_inputs_are_not_blamed_on_arguments() -> None:
    with pytest.raises(WrongArguments, match="size"), blaming_arguments():
        raise ValueError("size")
    with pytest.raises(InputError), blaming_arguments():
        raise InputError("it is damaged", "image size")
