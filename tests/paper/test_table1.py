"""From results to tables: what is done again, and what the page says of the images."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import attempt
from nablahog.paper import table1, table1_page
from nablahog.paper.methods import METHODS, Table1Settings

from .common import job, made, photographs, write_prior
from .fakes import BRIGHT, DARK, MISTAKEN


def test_done_once(tmp_path: Path, calls: list[str]) -> None:
    first = made(tmp_path, photographs(), DARK, MISTAKEN)
    assert sorted(calls) == ["dark"] * 3 + ["mistaken"] * 3
    calls.clear()
    second = made(tmp_path, photographs(), DARK, MISTAKEN)
    assert calls == ["mistaken"] * 3  # failures are no results
    assert second.figures == first.figures
    assert second.seconds == first.seconds
    seconds = first.seconds["dark"].values()
    assert [line.seconds for line in first.table_rows()] == [pytest.approx(sum(seconds) / 3), None]
    calls.clear()
    made(tmp_path, photographs(4), DARK, BRIGHT)
    assert sorted(calls) == ["dark"] + ["uoctti-single"] * 4


def test_the_seconds_are_those_that_passed() -> None:
    began = time.perf_counter()
    result = attempt(job(BRIGHT))
    assert isinstance(result, JobResult)
    assert 0 < result.seconds < time.perf_counter() - began


def test_remarks_on_what_a_prior_has_seen(tmp_path: Path) -> None:
    learned = METHODS["uoctti-learned"]
    assert learned.spec is not None
    for seen, remarks in (("a.png",), 0), (("a.png", "1.png"), 1), (("a.png", "1.png, 1/2, 0, 64"), 1):
        prior = write_prior(tmp_path / "p.npz", learned.spec, images=seen)
        said = table1_page.remarks([], {"prior": prior}, photographs(2))
        assert ["learned from images of the same names as 1 of these" in remark for remark in said] == [True] * remarks
    (remark,) = table1_page.remarks([learned], {}, photographs(2))
    assert "uoctti-learned is optional" in remark


@pytest.mark.parametrize("turned", [True, False])
def test_mi_has_no_mean_over_images_of_several_sizes(tmp_path: Path, calls: list[str], turned: bool) -> None:
    """A turned image has as many pixels, so the bias of its MI is that of the others."""
    some = photographs(2)
    some.images = {"0.png": some.images["0.png"][:16], "1.png": some.images["1.png"][:, : 16 if turned else 15]}
    table = made(tmp_path, some, BRIGHT)
    assert {line.statistics["mi"].n for line in table.table_rows()} == {2 if turned else 0}
    assert ["MI" in remark for remark in table1_page.remarks([], {}, some)] == [True] * (not turned)
    assert None not in [figures["mi"] for figures in table.figures["uoctti-single"].values()]


@pytest.mark.parametrize(("size", "described"), [(3, 0), (4, 1)])
def test_pictures_of_some_images(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, size: int, described: int
) -> None:
    """Without glyphs of one that is smaller than a cell."""
    monkeypatch.setattr(table1, "SHOWN", 1)
    method = replace(BRIGHT, spec=METHODS["uoctti-single"].spec)
    page = table1_page.page(made(tmp_path, photographs(2, size), method), Table1Settings(), "Squares.")
    assert "1 of the 2 images, evenly spread" in page
    counts = [page.count(f'alt="{seen}') for seen in ("The image", "Strokes along the edges", "What uoctti-single")]
    assert counts == [1, described, 1]


@pytest.mark.parametrize(("size", "left_out"), [(4, ["SSIM"]), (32, [])])
def test_a_measure_without_figures_has_no_column_of_the_paper(
    tmp_path: Path, calls: list[str], size: int, left_out: list[str]
) -> None:
    """Windows of SSIM are larger than 4 pixels."""
    table = made(tmp_path, photographs(2, size), BRIGHT)
    columns = set(table1_page.terminal_rows(table)[0])
    measures = ("CC", "MI", "SSIM")
    assert [name for name in measures if name not in columns] == left_out
    assert [name for name in measures if f"{name}\npaper" not in columns] == left_out
