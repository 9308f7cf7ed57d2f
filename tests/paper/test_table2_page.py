"""The page and what the terminal shows of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from nablahog.paper import table2_page
from nablahog.paper.pose_methods import Table2Settings
from nablahog.paper.table2 import Table2, run_table2
from nablahog.viz.html import figure

from .fakes import FAR, NEAR, OTHER, examples


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
    for number in ("75.0", "58.9", "47.3", "16.9", "8.000", "100.0"):
        assert f">{number}<" in html
    accuracy = table.table_rows()[1].accuracy["interval", 4]
    assert f"{accuracy.low:.1f} … {accuracy.high:.1f}" in html
    criteria = "4, 8, 16, 24 views: by interval", "&lt; 90°, &lt; 45°, &lt; 22.5°, &lt; 15°: by threshold"
    for name in (*criteria, "rotation, rotation error", "median error, error", "paper", "best", "exemplar"):
        assert f"<dt>{name}</dt>" in html
    assert "Made up." in html
    assert "seed 7" in html
    assert "nan" not in _text(html).lower().split()


def test_failures_are_listed_and_counted(table: Table2) -> None:
    text = _text(_html(table))
    assert "2 failed, see below" in text
    assert "Failed: 2" in text
    for failure in ("no &lt;image&gt;", "no element", "&lt;bad&gt;"):
        assert failure in text


def test_pictures(table: Table2) -> None:
    html = _html(table)
    images, result = 4, 3 + 4 + 4
    assert html.count("data:image/png;base64,") == images + result
    assert 'alt="1 with the outline of a model at the pose that paper found"' in html
    assert 'alt="0 with the outline of a model at the pose that exemplar found"' not in html
    assert "+8°\nchair-02" in html
    assert "http" not in html.replace("http://www.w3.org/", "")  # names of SVG, which nobody loads


def test_terminal(table: Table2) -> None:
    rows = {row["method"]: row for row in table2_page.terminal_rows(table)}
    assert (rows["paper"]["4 views"], figure(rows["paper"]["< 90°"])) == ("75.0 (58.9)", "100.0")
    assert (rows["paper"]["24 views"], figure(rows["paper"]["< 15°"])) == ("25.0 (16.9)", "100.0")
    assert rows["other"]["24 views"] == "0.0"
    assert len({tuple(row) for row in rows.values()}) == 1
    rotations = {row["method"]: row for row in table2_page.terminal_rotations(table)}
    assert (rotations["paper"]["rotation ≤ 30°"], rotations["exemplar"]["rotation ≤ 10°"]) == (100, 0)
    assert rotations["exemplar"]["objects"] == 4
    assert 8 < float(str(rotations["paper"]["rotation error"])) < 10


def test_conditions(tmp_path: Path, calls: list[str]) -> None:
    harder = {"sides-5": examples([40, 350], prefix="sides-5/"), "tilted": examples([90], prefix="tilted/")}
    table = run_table2(tmp_path, examples([0, 90]), [NEAR, OTHER], Table2Settings(), harder, workers=1)
    html = _html(table)
    section = html[html.index("<h2>Harder conditions") : html.index("<h2>Pictures")]
    text = re.sub(r"\s+", " ", _text(section))
    assert "condition method objects 4 views 8 views 16 views 24 views &lt; 15°" in text
    assert "sides-5 paper 2 50.0" in text
    assert section.count("data:image/png;base64,") == 2  # an object of each
    assert "<dt>tilted</dt>" in html
    assert "In-plane rotations of 12 to 45°" in html
    rows = table2_page.terminal_conditions(table)
    assert [(row["condition"], row["method"], row["objects"]) for row in rows] == [
        ("sides-5", "paper", 2),
        ("sides-5", "other", 2),
        ("tilted", "paper", 1),
        ("tilted", "other", 1),
    ]
    assert [figure(rows[0][name]) for name in ("4 views", "< 15°")] == ["50.0", "100.0"]
    assert "Harder conditions" not in _html(_table_of(tmp_path))


def _table_of(folder: Path) -> Table2:
    return run_table2(folder, examples([0, 90]), [NEAR], Table2Settings(), workers=1)
