"""``nablahog dialects`` as people use and misuse it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli.main import main

from ..common import CHELSEA, names

SMALL = ["--presets", "vlfeat,dpm,skimage", "--size", "64"]
RESULTS = ["dialects.csv", "dialects.svg", "index.html", "ties.csv"]


class _Text(HTMLParser):
    """All text of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text = ""
        self.feed(html)

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_table(photo: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dialects", photo, *SMALL]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "cat.png, shrunk to 48x64 pixels" in printed.out
    assert "The same in a common form: vlfeat, dpm." in printed.out
    for text in ("1 ", "dpm – vlfeat", "dpm – skimage", "between two bins", "90°, 270°", "√2 = 1.414", "Shapley"):
        assert text in printed.out.replace("vlfeat – dpm", "dpm – vlfeat")
    assert names(tmp_path) == ["in"]


def test_the_files(photo: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "out"
    assert main(["dialects", photo, "-o", str(out), *SMALL]) == 0
    assert f"Look at {out / 'index.html'}" in capsys.readouterr().out
    assert names(out) == RESULTS
    with open(out / "dialects.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["compared"] for row in rows} == {"common form", "directed undirected texture"}
    with open(out / "ties.csv", newline="") as file:
        ties = {row["preset"]: row for row in csv.DictReader(file)}
    assert 0 < float(ties["vlfeat"]["between_bins"]) < 1
    assert ties["skimage"]["between_colours"] == ""
    html = (out / "index.html").read_text()
    text = _Text(html).text
    assert "<img" in html
    for heading in (
        "Distances",
        "Why",
        "Channels with the same meaning",
        "Ties",
        "The presets",
        "What the figures mean",
    ):
        assert heading in text
    assert html.count("data:image/png;base64,") == 1 + 3
    assert (out / "dialects.svg").read_text() in html
    assert 'alt="Strokes along the edges of the photograph, cell by cell, of its vlfeat HOG"' in html
    share = 100 * float(ties["vlfeat"]["between_bins"])
    assert f'data-value="{share / 100!r}">{share:.1f}%<' in html  # sorted by the number


def test_json(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dialects", photo, *SMALL, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["image_size"] == [48, 64]
    assert list(said["presets"]) == ["vlfeat", "dpm", "skimage"]
    assert len(said["pairs"]) == 3
    for pair in said["pairs"]:
        ground = pair["common_form"]
        if not ground["same"]:
            assert sum(each["share"] for each in ground["shares"]) == pytest.approx(ground["distance"] ** 2, rel=1e-6)
    assert said["ties"]["skimage"]["between_colours"] is None
    assert "distance" in said["definitions"]


def test_all_presets_of_a_gray_photograph(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(CHELSEA[..., 0]).save(tmp_path / "gray.png")
    assert main(["dialects", str(tmp_path / "gray.png"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["presets"]) == 13
    assert len(said["pairs"]) == 78
    assert not any("colour" in each["convention"] for pair in said["pairs"] for each in pair["common_form"]["shares"])


def test_parameters_of_presets(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = "opencv,opencv:gamma=false,vlfeat:bilinear_orientations=true:orientations=8"
    assert main(["dialects", photo, "--presets", wanted, "--cell", "4", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert list(said["presets"]) == wanted.split(",")
    assert all(spec["cell_size"] == [4, 4] for spec in said["presets"].values())
    (share,) = said["pairs"][0]["common_form"]["shares"]
    assert (share["convention"], share["a"], share["b"]) == ("gamma", "gamma=sqrt", "gamma=none")


def test_two_presets_need_no_matrix(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dialects", photo, "--presets", "paper,skimage"]) == 0
    printed = capsys.readouterr().out
    assert "paper – skimage" in printed
    assert "1 paper" not in printed


def test_a_photograph_with_no_gradient(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.new("RGB", (40, 32), "red").save(tmp_path / "flat.png")
    assert main(["dialects", str(tmp_path / "flat.png"), "-o", str(tmp_path / "out"), *SMALL]) == 0
    assert "The same in a common form: vlfeat, dpm, skimage." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("presets", "message"),
    [
        ("vlfeat", "expected at least two presets, separated by commas, got 'vlfeat'"),
        ("vlfeat,hogg", "expected presets of aubry, cnn_hog, dalal_triggs, dlib, dpm"),
        ("vlfeat,dpm,vlfeat", "expected different presets, got vlfeat twice"),
        ("vlfeat,", "got ''"),
        ("vlfeat,opencv:gamma", "expected KEY=VALUE, a parameter of the preset, got 'gamma'"),
    ],
)
def test_presets_that_are_none(photo: str, refused: Callable[..., None], presets: str, message: str) -> None:
    refused("dialects", photo, "--presets", presets, "-o", "out", message=message, status=2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--presets", "dpm,opencv:gamma=7"], "expected true or false, got '7'"),
        (["--presets", "dpm,opencv:gama=true"], "opencv has no parameter 'gama'"),
        (["--presets", "dpm,dlib", "--cell", "1"], "cell_size must be at least 2"),
        (["--presets", "dpm,dlib", "--cell", "8x4"], "cells of dpm are square"),
        (["--presets", "dpm,dlib", "--cell", "40"], "too few for a d"),
        (["--size", "12"], "an image of 9x12"),
    ],
)
def test_what_does_not_fit(
    photo: str, tmp_path: Path, refused: Callable[..., None], options: list[str], message: str
) -> None:
    refused("dialects", photo, "-o", str(tmp_path / "out"), *options, message=message)


def test_bad_photographs_and_folders(photo: str, tmp_path: Path, refused: Callable[..., None]) -> None:
    refused("dialects", str(tmp_path / "none.png"), message="no such file")
    refused("dialects", photo, "-o", photo, *SMALL, message="cannot be made")
    target = tmp_path / "in" / "dialects.svg"
    target.write_bytes(Path(photo).read_bytes())
    refused("dialects", str(target), "-o", str(target.parent), *SMALL, message="would overwrite an input")
