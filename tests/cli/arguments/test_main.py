"""Help and version."""

from __future__ import annotations

import pytest

from nablahog.cli.main import main
from nablahog.paper.names import TABLE1, TABLE2


def test_methods_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    for command, methods in (("table1", TABLE1), ("table2", TABLE2)):
        assert main([command, "--list-methods"]) == 0
        printed = capsys.readouterr().out.splitlines()
        assert [line.split()[0] for line in printed] == [*methods]
    assert main(["table1", "--list-methods"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["uoctti-single"].endswith("  runs")
    assert lines["opencv"].endswith("  with --methods only")
    assert lines["uoctti-learned"].endswith("  runs")
    assert lines["hoggles"].endswith("  runs; learns hoggles the first time")
    assert max(map(len, lines.values())) <= 100


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("nablahog 0")
    for command in ([], ["hog"], ["glyph"], ["invert"], ["demo"], ["table1"], ["learn"], ["learn", "prior"]):
        assert main([*command, "--help"]) == 0
        assert "usage: nablahog" in capsys.readouterr().out
