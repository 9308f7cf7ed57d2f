"""The page and what the terminal shows of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from nablahog.evaluate import table2_page
from nablahog.evaluate.pose_methods import Table2Settings
from nablahog.evaluate.table2 import Table2, run_table2
from nablahog.evaluate.table2_page import histogram

from .pose_fakes import FAR, NEAR, OTHER, examples


@pytest.fixture
def table(tmp_path: Path, calls: list[str]) -> Table2:
    some = examples([0, 90, 40, 350])
    some.failed["<bad>"] = "no <image>"
    return run_table2(tmp_path, some, [FAR, NEAR, OTHER], Table2Settings(), workers=1)


def _html(table: Table2) -> str:
    return table2_page.page(table, Table2Settings(7))


def _text(html: str) -> str:
    return re.sub(r"<[^>]*>", "\n", html)


def test_figures_and_definitions(table: Table2) -> None:
    html = _html(table)
    for figure in ("75.0", "58.9", "47.3", "16.9", "8.000", "100.0"):
        assert f">{figure}<" in html
    accuracy = table.lines()[1].accuracy["interval", 4]
    assert f"{accuracy.low:.1f} … {accuracy.high:.1f}" in html
    criteria = "4, 8, 16, 24 views: by interval", "&lt; 90°, &lt; 45°, &lt; 22.5°, &lt; 15°: by threshold"
    for name in (*criteria, "rotation, rotation error", "median error, error", "paper", "best", "exemplar"):
        assert f"<dt>{name}</dt>" in html
    assert "Made up." in html
    assert "seed 7" in html
    assert "nan" not in _text(html).lower().split()


def test_both_criteria_and_rotations_are_columns(table: Table2) -> None:
    html = _html(table)
    first = re.sub(r"\s+", " ", _text(html[html.index("<table") : html.index("</table>")]))
    for views, angle in ((4, "90"), (8, "45"), (16, "22.5"), (24, "15")):
        assert f"{views} views {views} views paper &lt; {angle}°" in first
    rotation = _text(html[html.index("<h2>Rotation") : html.index("<h2>How far off")])
    for text in ("≤ 30°, %", "≤ 10°, %", "median error", "100.0"):
        assert text in rotation


def test_failures_are_listed_and_counted(table: Table2) -> None:
    text = _text(_html(table))
    assert "2 failed, see below" in text
    assert "Failed: 2" in text
    for failure in ("no &lt;image&gt;", "no element", "&lt;bad&gt;"):
        assert failure in text


def test_pictures(table: Table2) -> None:
    html = _html(table)
    images, result, histograms = 4, 3 + 4 + 4, 3
    assert html.count("data:image/png;base64,") == images + result + histograms
    assert 'alt="1, paper"' in html
    assert 'alt="0, exemplar"' not in html
    assert "+8°\ntwo" in html
    assert "http" not in html


def test_histograms_say_what_they_show(table: Table2) -> None:
    text = _text(_html(table))
    assert "paper: 100, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 %" in text or "paper: 100, 0" in _html(table)
    assert "exemplar: 0, 0, 0, 0, 0, 0, 75, 0, 0, 0, 0, 25 %" in text


def test_bars() -> None:
    low, high = histogram(np.array([0.25, 0.5]), 0.5), histogram(np.array([0.5, 0.25]), 0.5)
    assert low.shape == high.shape
    dark = [(picture[:110] < 0.5).sum(axis=0) for picture in (low, high)]
    half = low.shape[1] // 2
    assert dark[0][:half].sum() < 0.6 * dark[0][half:].sum()
    assert dark[1][half:].sum() < 0.6 * dark[1][:half].sum()


def test_terminal(table: Table2) -> None:
    rows = {row["method"]: row for row in table2_page.terminal_rows(table)}
    assert (rows["paper"]["4 views"], rows["paper"]["< 90°"]) == ("75.0 (58.9)", "100.0")
    assert (rows["paper"]["24 views"], rows["paper"]["< 15°"]) == ("25.0 (16.9)", "100.0")
    assert rows["other"]["24 views"] == "0.0"
    assert len({tuple(row) for row in rows.values()}) == 1
    rotations = {row["method"]: row for row in table2_page.terminal_rotations(table)}
    assert (rotations["paper"]["rotation ≤ 30°"], rotations["exemplar"]["rotation ≤ 10°"]) == ("100.0", "0.0")
    assert rotations["exemplar"]["objects"] == 4
    assert 8 < float(str(rotations["paper"]["rotation error"])) < 10


def test_without_failures_and_methods(tmp_path: Path, calls: list[str]) -> None:
    html = _html(run_table2(tmp_path, examples([10.0]), [OTHER], Table2Settings(), workers=1))
    assert "Failed" not in html
    assert ">–<" in html  # the baseline did not run
