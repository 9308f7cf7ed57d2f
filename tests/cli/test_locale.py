"""Names of files with letters that the locale lacks, given to the command or read from a list or a material."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nablahog.io.descriptor_dataset import DescriptorDataset

IN_C = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
NAME = "stühle [1].png"
WEDGE = "OFF\n6 5 0\n0 0 0\n2 0 0\n2 1 0\n0 1 0\n0 1 2\n2 1 2\n4 0 1 2 3\n4 3 2 5 4\n4 4 5 1 0\n3 0 3 4\n3 1 5 2\n"


def _run(folder: Path, *words: str) -> str:
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=folder, env=IN_C, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(tmp_path / NAME)
    return tmp_path


@pytest.mark.parametrize("given", [NAME, "@list.txt"])
def test_a_data_set(folder: Path, given: str) -> None:
    (folder / "list.txt").write_text(f"{NAME}\n", "utf-8")
    _run(folder, "-m", "nablahog", "hog", given, "-o", "ü.parquet", "--workers", "1", "--quiet")
    (row,) = DescriptorDataset(str(folder / "ü.parquet"))
    assert (row.path, row.error) == (NAME, None)


def test_poses(folder: Path) -> None:
    (folder / "wedge_ü.off").write_text(WEDGE)
    (folder / "list.csv").write_text(f"image,x0,y0,x1,y1\n{NAME},5,5,60,60\n", "utf-8")
    options = ["--mesh", "wedge_ü.off", "--annotations", "list.csv", "--method", "paper", "--least-confidence", "0"]
    _run(folder, "-m", "nablahog", "pose", ".", *options, "-o", "out", "--quiet")
    with open(folder / "out" / "poses.csv", encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["image"], row["model"], row["error"]) == (NAME, "wedge_ü", "")


def test_a_texture(folder: Path) -> None:
    Image.fromarray(np.full((8, 8), 51, np.uint8)).save(folder / NAME)
    (folder / "ü.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {NAME}\n", "utf-8")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .5 .5\n"
    (folder / "a.obj").write_text(f"mtllib ü.mtl\n{corners}usemtl m\nf 1/1 2/1 3/1\n", "utf-8")
    code = "from nablahog.render import load_mesh; print(load_mesh('a.obj').brightness.tolist())"
    assert _run(folder, "-c", code).split() == ["[0.2,", "0.2,", "0.2]"]


def test_images_of_a_data_set(folder: Path) -> None:
    _run(folder, "-m", "nablahog", "hog", NAME, "-o", "a.parquet", "--workers", "1", "--quiet")
    _run(folder, "-m", "nablahog", "invert", "a.parquet", "-o", "out", "--quality", "fast", "--quiet")
    assert "000000_stühle [1]_preimage.png" in os.listdir(folder / "out")
