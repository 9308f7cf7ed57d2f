"""`nablahog table1` as people use and misuse it; interrupted and killed it is in ``tests/fuzz/test_kills.py``."""

from __future__ import annotations

import csv
import os
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli.commands.tables import _photographs
from nablahog.cli.main import main

from ..common import CHELSEA, names

TABLES = ["failures.csv", "index.html", "per_image.csv", "summary.csv", "times.csv"]
QUICK = ["--methods", "dalal-multi-scale,dalal-single", "--max-evaluations", "60", "--size", "32", "--workers", "1"]


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Five small photographs and a file that is none."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(5):
        Image.fromarray(CHELSEA[4 * k : 4 * k + 32, 8 * k : 8 * k + 32]).save(folder / f"{k}.png")
    (folder / "x.png").write_bytes(b"no image")
    return str(folder)


def test_the_command(tmp_path: Path, images: str, here: None, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["table1", "--images", images, "-o", str(out), *QUICK, "--max-evaluations", "3", "--limit", "6"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in ("dalal-single", "0.170", "Ran: ", str(out / "index.html")):
        assert text in printed.out
    assert "hoggles" not in printed.out  # which was not asked for
    assert printed.out.index("dalal-multi-scale ") < printed.out.index("\n  @1/64 ")
    assert "Failed: x.png, all methods: expected an image" in printed.out
    assert names(out) == [*TABLES, "work"]
    html = (out / "index.html").read_text()
    for text in ("6 images of the folder images.", "x.png", "Pearson correlation"):
        assert text in html
    with open(out / "per_image.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows[:6]] == ["dalal-single"] * 5 + ["dalal-multi-scale"]  # in the table's order


def test_a_part_of_a_folder_is_said_to_be_one(images: str) -> None:
    for limit, count in ((2, "The first 2 of 6 images"), (None, "6 images")):
        assert _photographs(Namespace(images=images, size=32, limit=limit))[1] == f"{count} of the folder images."


def test_what_it_refuses(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes.txt").touch()
    to = ["table1", "-o", str(tmp_path / "out")]
    refused(*to, "--methods", "dalal-single,hog", message="expected methods such as hoggles, ", status=2)
    refused(*to, "--learned", "prior", message="expected KIND=FILE", status=2)
    refused(*to, "--images", str(tmp_path / "empty"), message="expected a folder of images, but it holds none")
    refused(*to, "--images", images, "--learned", f"prior={images}/no", message="no such file")
    options = ["--learned", f"prior={images}/0.png", "--methods", "dalal-single"]
    refused(*to, "--images", images, *options, message="these do: uoctti-learned", status=2)


def test_no_result_at_all(tmp_path: Path, images: str, here: None, refused: Callable[..., None]) -> None:
    for name in os.listdir(images):
        Path(images, name).write_bytes(b"no image")
    message = "no image has a result; the first: 0.png: expected an image"
    refused("table1", "--images", images, "-o", str(tmp_path / "out"), *QUICK, message=message)
