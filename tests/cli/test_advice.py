"""What errors advise: at the shell it is an option that the command has."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import nablahog
from nablahog.cli.arguments.options import Parser
from nablahog.cli.errors import OPTIONS, name_options
from nablahog.cli.main import parser
from nablahog.render.mesh import axes
from nablahog.requests.dialect import PRESETS, preset_parameters

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
    for file in sorted(folder.rglob("*.py")):
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
    for place, sentence in sentences(PACKAGE / "cli" / "commands"):
        if place.startswith(f"{module}.py"):
            assert {*re.findall(r"--[a-z][a-z-]+", sentence)} <= flags(command), f"{place}: {sentence}"


def test_a_sentence_of_the_library_is_worded_with_options() -> None:
    with pytest.raises(ValueError, match="give `front`, too") as refusal:
        axes("x")
    assert "give --front, too" in name_options(str(refusal.value))
    assert name_options("`initial` and `nothing`") == "--init and nothing"
