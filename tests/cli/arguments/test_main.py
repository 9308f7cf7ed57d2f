"""Help and version."""

from __future__ import annotations

import pytest

from nablahog.cli.main import main


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("nablahog 0")
    for command in ([], ["hog"], ["glyph"], ["invert"], ["demo"], ["table1"], ["learn"], ["learn", "prior"]):
        assert main([*command, "--help"]) == 0
        assert "usage: nablahog" in capsys.readouterr().out
