"""A command: a photograph in, a file out, and a status."""

from __future__ import annotations

from pathlib import Path

import pytest

from nablahog import load_descriptor
from nablahog.cli.main import main


def test_hog(photo: str, tmp_path: Path) -> None:
    assert main(["hog", photo, "-o", str(tmp_path / "d.npz")]) == 0
    assert load_descriptor(tmp_path / "d.npz").descriptor.shape == (8, 10, 31)  # of 60x80 pixels


def test_a_refusal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hog", str(tmp_path / "none.png"), "-o", str(tmp_path / "d.npz")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())
