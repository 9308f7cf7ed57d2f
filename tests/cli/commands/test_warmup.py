"""``nablahog warmup``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nablahog.cli.main import main
from nablahog.runtime.cache_folder import VARIABLE
from nablahog.runtime.processor import levels

COMPILES = """
import logging, sys
logging.basicConfig(level=logging.INFO, stream=sys.stdout)
import torch
import nablahog
images = torch.rand(1, 3, 40, 24, requires_grad=True)
nablahog.hog(images, nablahog.presets.paper()).sum().backward()
"""


@pytest.mark.parametrize("portable", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_process_after_it_compiles_nothing(portable: bool, tmp_path: Path) -> None:
    environment = os.environ | {VARIABLE: str(tmp_path)}

    def run(*command: str) -> str:
        return subprocess.run(
            [sys.executable, *command], env=environment, capture_output=True, text=True, check=True
        ).stdout

    for_all = portable and levels()
    warmed = run("-m", "nablahog", "warmup", "paper", *(["--portable"] if for_all else []))
    assert warmed.count(f" s, kept in {tmp_path / 'machine-code'}\n") == (len(levels()) if for_all else 1)
    assert run("-c", COMPILES) == ""
    assert run("-m", "nablahog", "warmup", "paper").startswith("0 functions compiled")


def test_a_processor_like_no_other(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("nablahog.cli.commands.warmup.levels", list)
    assert main(["warmup", "--portable"]) == 1
    assert "leave out --portable" in capsys.readouterr().err


def test_an_unknown_step(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warmup", "sift"]) == 1
    assert "expected steps of aubry, " in capsys.readouterr().err


def test_nowhere_to_keep_it(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("nablahog.cli.commands.warmup.code_folder", lambda: None)
    assert main(["warmup"]) == 1
    assert "set NABLAHOG_CACHE_DIR to one that you may write" in capsys.readouterr().err
