"""``nablahog demo``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from nablahog.cli.commands import demo
from nablahog.cli.main import main

from ..common import names


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "SIZE", 64)
    assert main(["demo", "-o", str(tmp_path / "demo")]) == 0
    assert f"Look at {tmp_path / 'demo' / 'index.html'}" in capsys.readouterr().out
    parts = ("difference", "glyphs", "preimage", "thumbnails")
    pictures = [f"{name}_{part}.png" for name in ("paper", "uoctti") for part in parts]
    assert names(tmp_path / "demo") == sorted([*pictures, "photograph.png", "figures.json", "index.html"])
    assert [row["descriptor"] for row in json.loads((tmp_path / "demo" / "figures.json").read_text())] == [
        "uoctti",
        "paper",
    ]
    html = (tmp_path / "demo" / "index.html").read_text()
    assert html.count("data:image/png;base64,") == 2 + 8 + html.count('alt="The negative')  # if the prior is unsure
    assert "http" not in html
