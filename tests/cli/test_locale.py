"""Names of files that lists have in UTF-8, where the locale knows none of their letters."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import torch

from nablahog.io.images import write_image

C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def run(folder: Path, *arguments: str) -> int:
    command = [sys.executable, "-m", "nablahog", *arguments, "--quiet"]
    done = subprocess.run(command, cwd=folder, env={**os.environ, **C_LOCALE}, capture_output=True, check=False)
    assert b"Traceback" not in done.stderr
    return done.returncode


def test_lists_and_data_sets(tmp_path: Path) -> None:
    write_image(tmp_path / "naïve.png", torch.rand(1, 40, 40))
    (tmp_path / "list.txt").write_text("naïve.png\n", encoding="utf-8")
    assert run(tmp_path, "hog", "@list.txt", "-o", "all.parquet") == 0
    assert run(tmp_path, "invert", "all.parquet", "-o", "out", "--quality", "fast") == 0
    assert any("naïve" in name for name in os.listdir(tmp_path / "out"))


def test_objects(tmp_path: Path) -> None:
    write_image(tmp_path / "naïve.png", torch.rand(1, 60, 60))
    (tmp_path / "objects.csv").write_text("image,azimuth,elevation\nnaïve.png,30,10\n", encoding="utf-8")
    command = ["pose", ".", "--annotations", "objects.csv", "--method", "exhaustive", "--least-confidence", "0"]
    assert run(tmp_path, *command, "-o", "out") == 0
    assert (tmp_path / "out" / "poses.csv").read_text(encoding="utf-8").splitlines()[1].startswith("naïve.png,1,")
