"""Completion in the shell, as argcomplete's shell function asks for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import nablahog

pytest.importorskip("argcomplete")


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
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    command = ["sh", "-c", f"exec {sys.executable} -m nablahog 8>&1 9>/dev/null"]
    ended = subprocess.run(command, env={**os.environ, **asked}, capture_output=True, text=True)
    assert {word.strip() for word in ended.stdout.split("\n")} == expected


def test_the_command_says_that_it_can() -> None:
    """Global completion looks for this mark in the first kilobyte of the entry point."""
    assert "PYTHON_ARGCOMPLETE_OK" in Path(nablahog.__file__).with_name("__main__.py").read_text()[:1024]
