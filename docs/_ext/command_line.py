"""The directive ``command-line``: all commands and their options, from the parsers that the command itself uses."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterator
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

from nablahog import requests
from nablahog.cli import arguments
from nablahog.cli.main import parser

WIDTH = 72  # of the usage, in characters


class CommandLine(SphinxDirective):
    """A section for each command, with its usage, its arguments and its options."""

    def run(self) -> list[nodes.Node]:
        folders = [Path(module.__path__[0]) for module in (arguments, requests)]
        for source in (*(file for folder in folders for file in folder.glob("*.py")), Path(__file__)):
            self.env.note_dependency(str(source))
        os.environ["COLUMNS"] = str(WIDTH)  # where argparse looks for it
        section = nodes.section()
        section.document = self.state.document
        lines = [line for command in commands(parser()) for line in described(*command)]
        nested_parse_with_titles(self.state, StringList(lines, source="command line"), section)
        return list(section.children)


def commands(
    above: argparse.ArgumentParser, about: str = "", depth: int = 0
) -> Iterator[tuple[argparse.ArgumentParser, str, int]]:
    """Each command below a parser, in their order, with its line of help and how deep it is."""
    for action in above._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {each.dest: each.help or "" for each in action._choices_actions}
            for name, below in action.choices.items():
                yield below, helps.get(name, about), depth
                yield from commands(below, depth=depth + 1)


def described(command: argparse.ArgumentParser, about: str, depth: int) -> Iterator[str]:
    """The lines, reStructuredText, of one command."""
    yield from (command.prog, "-~"[depth] * len(command.prog), "")
    yield from (f"*{escaped(about[:1].upper() + about[1:])}.*", "") if about else ()
    yield from (markup(command.description or ""), "", ".. code-block:: text", "")
    yield from (f"   {line[len('usage: ') :]}" for line in command.format_usage().splitlines())
    yield from ("", f".. program:: {command.prog}", "")
    for action in command._actions:
        if isinstance(action, argparse._HelpAction) or action.help == argparse.SUPPRESS:
            continue
        if isinstance(action, argparse._SubParsersAction):
            continue
        formatter = command._get_formatter()
        text = markup(formatter._expand_help(action)) if action.help else ""
        yield from (f".. option:: {signature(action, formatter)}", "", f"   {text}", "")


def signature(action: argparse.Action, formatter: argparse.HelpFormatter) -> str:
    """The names of an option with its value, as ``-o FILE, --output FILE``; the name of an argument."""
    if not action.option_strings:
        return str(action.metavar or action.dest)
    value = "" if action.nargs == 0 else " " + formatter._format_args(action, action.dest.upper())
    return ", ".join(name + value for name in action.option_strings)


def markup(text: str) -> str:
    """A help text as reStructuredText: what is between backticks, and names of options, as code."""
    parts = re.split(r"`([^`]*)`|(?<!\S)(--?[a-z][a-z0-9-]*(?:=[^\s,;]+)?)", text)
    parts = [part for part in parts if part is not None]
    marked = (f"``{part}``" if number % 2 else escaped(part) for number, part in enumerate(parts))
    return " ".join("".join(marked).split())


def escaped(text: str) -> str:
    """The text with nothing in it that reStructuredText takes for markup."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
