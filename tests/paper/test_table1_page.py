"""The page and what the terminal shows of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from nablahog.paper import table1_page
from nablahog.paper.methods import METHODS, ReconstructionMethod, Table1Settings
from nablahog.paper.names import UOCTTI
from nablahog.paper.table1 import Table1

from .common import made, photographs, write_prior
from .fakes import BRIGHT, LEVELS

SEEN = ReconstructionMethod("uoctti-single", UOCTTI, BRIGHT.run, METHODS["uoctti-single"].spec)


@pytest.fixture
def table(tmp_path: Path, calls: list[str]) -> Table1:
    some = photographs(3)
    some.images["<b>.png"] = some.images["0.png"][:30].contiguous()
    some.failed["bad.png"] = "no <image>"
    some.ignored.append("notes.txt")
    return made(tmp_path, some, SEEN, LEVELS)


def _html(table: Table1) -> str:
    return table1_page.page(table, Table1Settings(7, max_evaluations=9), "Images of mine.")


def _text(html: str) -> str:
    return re.sub(r"<[^>]*>", "\n", html)


def test_figures_and_definitions(table: Table1) -> None:
    html = _html(table)
    mean = table.table_rows()[0].statistics["cc"]
    for number in (mean.mean, mean.median, 0.760, 1.908, 0.433, 0.121):
        assert f"{number:.3f}" in html
    assert f"{mean.low:.3f} … {mean.high:.3f}\nmedian {mean.median:.3f}" in html
    for name in ("UoCTTI HOG", "Dalal&#39;s HOG", *LEVELS.rows, "bovw", "seconds"):
        assert name in html
    for name in ("CC", "|CC|", "MI", "SSIM", "PSNR", "distance", "NAME@1/s", "mean, interval, median"):
        assert f"<dt>{name}</dt>" in html
    assert "Images of mine." in html
    assert "seed 7, at most 9 evaluations" in html
    assert "nan" not in _text(html).lower().split()


def test_failures_are_listed_and_counted(table: Table1) -> None:
    text = _text(_html(table))
    assert "2 failed, see below" in text
    assert "Failed: 2" in text
    for failure in ("no &lt;image&gt;", "no scale 1/64", "&lt;b&gt;.png"):
        assert failure in text
    assert "notes.txt" in text


def test_pictures(table: Table1) -> None:
    html = _html(table)
    glyphs = 4
    photographed, result = 4 + 2, 4 + 3  # the picture table, and two images at four levels below it
    assert html.count("data:image/png;base64,") == glyphs + photographed + result + 2 * 4
    assert 'alt="What dalal-multi-scale@1/16 made of 1.png"' in html
    assert 'alt="What dalal-multi-scale made of &lt;b&gt;.png"' not in html
    assert "http" not in html


def test_remarks(table: Table1, tmp_path: Path) -> None:
    learned = METHODS["uoctti-learned"]
    assert learned.spec is not None
    assert table1_page.remarks([], {}, photographs(2)) == []
    assert table1_page.remarks([learned], {}, photographs(2)) == [
        "uoctti-learned is optional, and runs with a file of prior, see `nablahog learn prior`."
    ]
    for images, expected in [
        (("a.png",), []),
        (("a.png", "1.png"), ["The prior file was learned from images of the same"]),
        (("a.png", "1.png, 1/2, 0, 64"), ["The prior file was learned from images of the same names as 1 of these"]),
    ]:
        prior = write_prior(tmp_path / "p.npz", learned.spec, images=images)
        said = table1_page.remarks([], {"prior": prior}, photographs(2))
        assert [one[: len(start)] for one, start in zip(said, expected, strict=True)] == expected
    html = table1_page.page(table, Table1Settings(), "Images of mine.", ["One.", "Two <b>."])
    assert "notes.txt. One. Two &lt;b&gt;." in html


def test_terminal(table: Table1) -> None:
    rows = {row["method"]: row for row in table1_page.terminal_rows(table)}
    assert rows["uoctti-single"]["n"] == 4
    assert rows["dalal-multi-scale"]["n"] == 3
    assert rows["dalal-multi-scale"]["SSIM\npaper"] == 0.293
    assert [*rows][-5:] == ["dalal-multi-scale", "  @1/64", "  @1/16", "  @1/4", "  @1/1"]
    (columns,) = {tuple(row) for row in rows.values()}
    assert "PSNR" not in columns  # of which the page has room


def test_mi_has_no_mean_over_images_of_several_sizes(table: Table1, tmp_path: Path) -> None:
    """A turned image has as many pixels, so the bias of its MI is that of the others."""
    assert table.figures["uoctti-single"]["0.png"]["mi"] is not None
    assert {line.statistics["mi"].n for line in table.table_rows()} == {0}
    [remark] = table1_page.remarks([], {}, table.photographs)
    assert "MI" in remark
    some = photographs(2)
    some.images = {"0.png": some.images["0.png"][:16], "1.png": some.images["1.png"][:, :16]}
    assert {line.statistics["mi"].n for line in made(tmp_path / "turned", some, SEEN).table_rows()} == {2}
    assert table1_page.remarks([], {}, some) == []
