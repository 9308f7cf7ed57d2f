"""Text as a terminal gets it: without control characters for terminals, and of limited length; sentences of errors."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from nablahog.runtime.errors import explain
from nablahog.runtime.text import one_line, printable


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ä × 日本 1e-3", "ä × 日本 1e-3"),
        ("\x1b[31m\x07", "\\x1b[31m\\x07"),
        ("\x85\x9b31m", "\\x85\\x9b31m"),
        ("a\u202egnp.exe", "a\\u202egnp.exe"),
        ("a\nb\r\u2028", "a\\nb\\r\\u2028"),
        ("\udcff", "\\udcff"),
    ],
)
def test_printable(text: str, expected: str) -> None:
    assert printable(text) == expected
    assert printable(text).isprintable()


def test_one_line() -> None:
    assert one_line(ValueError("a\n  b\t\x1b")) == "a b \\x1b"
    long = one_line("a" * 5000 + "b" * 5000, 100)
    assert len(long) <= 100
    assert long.startswith("aaa")
    assert " … " in long
    assert long.endswith("bbb")
    assert one_line("a" * 100, 100) == "a" * 100


def test_errors_of_the_system_name_the_file_once_and_no_number(tmp_path: Path) -> None:
    missing = tmp_path / "it's missing.obj"
    for file in (missing, bytes(missing)):
        with pytest.raises(FileNotFoundError) as caught:
            os.stat(file)
        assert explain(caught.value) == f"{missing}: no such file or directory"
    assert explain(OSError(errno.ENOSPC, "No space left on device")) == "no space left on device"
    assert explain(FileNotFoundError("a.png: no such file")) == "a.png: no such file"
    assert explain(ValueError("No numbers")) == "No numbers"
