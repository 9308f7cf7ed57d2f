"""From poses to tables: how they are counted, formats, failures, reuse."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nablahog.paper.pose_methods import PoseMethod, Table2Settings
from nablahog.paper.table2 import Table2, run_table2
from nablahog.paper.table2_files import write_table2
from nablahog.paper.tables import Failure

from .pose_fakes import FAR, NEAR, OTHER, examples

AZIMUTHS = [0, 90, 40, 350]
FILES = ["failures.csv", "median_error.csv", "per_object.csv", "results.json", "rotation.csv", "summary.csv"]


def _made(folder: Path, *methods: PoseMethod, seed: int = 0) -> Table2:
    return run_table2(folder, examples(AZIMUTHS), methods, Table2Settings(seed), workers=1)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_how_they_are_counted(tmp_path: Path, calls: list[str]) -> None:
    """8° more: 40° leaves the first of 4 views, whose edge is 45°, and all but 40° leave theirs of 24, 15° wide."""
    table = _made(tmp_path, NEAR)
    (exemplar, paper) = table.lines()
    assert (exemplar.method, exemplar.accuracy["interval", 4].n, exemplar.error.median) == ("exemplar", 0, None)
    assert exemplar.paper == {4: 47.33, 8: 35.39, 16: 20.16, 24: 15.23}
    assert exemplar.seconds is None
    means = {of: paper.accuracy[of].mean for of in paper.accuracy}
    assert [means["interval", views] for views in (4, 8, 16, 24)] == [75, 100, 100, 25]
    assert [means["threshold", views] for views in (4, 8, 16, 24)] == [100] * 4
    assert paper.error.median == pytest.approx(8, abs=1e-4)
    assert 8 < (paper.rotation.median or 0) < 10  # with 5° of elevation and 1° in the image plane
    assert {angle: of.mean for angle, of in paper.within.items()} == {30: 100, 10: 100}
    assert (exemplar.rotation.median, exemplar.within[30].n) == (None, 0)
    assert table.errors("paper") == pytest.approx([8] * 4, abs=1e-4)
    accuracy = paper.accuracy["interval", 4]
    assert accuracy.low is not None
    assert accuracy.high is not None
    assert 0 <= accuracy.low < 75 < accuracy.high <= 100


def test_no_pose_is_wrong(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, FAR)
    assert table.failures == [Failure("0", "exemplar", "no element")]
    assert table.errors("exemplar") == pytest.approx([180, 100, 100, 100], abs=1e-4)
    assert table.rotation_errors("exemplar")[0] == 180
    assert (table.rotation_errors("exemplar")[1:] > 90).all()
    line = {line.method: line for line in table.lines()}["exemplar"]
    assert line.accuracy["threshold", 4].n == 4
    assert line.accuracy["threshold", 4].mean == 0


def test_a_method_that_finds_nothing(tmp_path: Path, calls: list[str]) -> None:
    table = run_table2(tmp_path, examples([0, 0]), [FAR], Table2Settings(), workers=1)
    line = {line.method: line for line in table.lines()}["exemplar"]
    assert line.accuracy["interval", 24].n == 2
    assert (line.error.median, line.seconds) == (180, None)


def test_files(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, FAR, NEAR)
    write_table2(tmp_path, table, Table2Settings())
    assert sorted(os.listdir(tmp_path)) == [*FILES, "work"]

    rows = _rows(tmp_path / "per_object.csv")
    assert list(rows[0]) == [
        *("object", "model", "method", "true_azimuth", "true_elevation", "true_theta"),
        *("azimuth", "elevation", "distance", "theta", "found_model", "error", "rotation_error", "seconds"),
    ]
    assert [(row["method"], row["object"]) for row in rows] == [
        *(("exemplar", each) for each in "123"),
        *(("paper", each) for each in "0123"),
    ]
    first = rows[3]
    assert float(first["azimuth"]) == table.figures["paper"]["0"]["azimuth"]  # to the last bit
    assert [first[name] for name in ("true_azimuth", "elevation", "model", "found_model")] == [
        "0",
        "15.0",
        "one",
        "two",
    ]

    assert float(first["true_theta"]) == 1
    turn = Rotation.from_euler("ZXZ", [[0, 105, -8], [-1, 110, 0]], degrees=True)
    expected = np.degrees((turn[0] * turn[1].inv()).magnitude())
    assert float(first["rotation_error"]) == pytest.approx(expected, abs=1e-4)

    rotation = _rows(tmp_path / "rotation.csv")
    assert [(row["method"], row["figure"], float(row["value"])) for row in rotation] == [
        ("exemplar", "median_error", pytest.approx(table.lines()[0].rotation.median)),
        *(("exemplar", f"within_{angle}_degrees", 0.0) for angle in (30, 10)),
        ("paper", "median_error", pytest.approx(expected, abs=1)),
        *(("paper", f"within_{angle}_degrees", 100.0) for angle in (30, 10)),
    ]

    summary = _rows(tmp_path / "summary.csv")
    assert list(summary[0]) == ["method", "criterion", "views", "accuracy", "low", "high", "paper"]
    assert [(row["method"], row["criterion"], row["views"]) for row in summary] == [
        (method, criterion, views)
        for method in ("exemplar", "paper")
        for criterion in ("interval", "threshold")
        for views in ("4", "8", "16", "24")
    ]
    assert (summary[8]["accuracy"], summary[8]["paper"]) == ("75.0", "58.85")
    assert summary[12]["paper"] == ""

    median = _rows(tmp_path / "median_error.csv")
    assert list(median[0]) == ["method", "objects", "median_error", "low", "high"]
    assert [(row["method"], row["objects"], float(row["median_error"])) for row in median] == [
        ("exemplar", "4", pytest.approx(100, abs=1e-4)),
        ("paper", "4", pytest.approx(8, abs=1e-4)),
    ]
    assert (tmp_path / "failures.csv").read_text() == "object,method,reason\n0,exemplar,no element\n"


def test_a_method_that_is_not_published(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, OTHER)
    write_table2(tmp_path, table, Table2Settings())
    assert [line.method for line in table.lines()] == ["exemplar", "paper", "other"]
    summary = _rows(tmp_path / "summary.csv")
    assert (summary[0]["accuracy"], summary[0]["paper"], summary[-1]["paper"]) == ("", "47.33", "")
    assert [row["method"] for row in _rows(tmp_path / "median_error.csv")] == ["other"]


def test_done_once(tmp_path: Path, calls: list[str]) -> None:
    first = _made(tmp_path, NEAR, FAR)
    assert sorted(calls) == ["exemplar"] * 4 + ["paper"] * 4
    calls.clear()
    second = _made(tmp_path, NEAR, FAR)
    assert calls == ["exemplar"]  # the failure
    assert second.figures == first.figures
    assert second.seconds == first.seconds
    calls.clear()
    assert _made(tmp_path, NEAR, seed=1).figures != first.figures
    assert calls == ["paper"] * 4


def test_in_processes(tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    here = _made(tmp_path / "here", NEAR, FAR)
    monkeypatch.undo()
    there = _made(tmp_path / "there", NEAR, FAR)
    assert there.figures == here.figures
    assert there.failures == here.failures


def test_pictures_of_a_few(tmp_path: Path, calls: list[str]) -> None:
    table = run_table2(tmp_path, examples(range(20)), [NEAR], Table2Settings(), workers=1)
    assert len(table.pictures["paper"]) == 9
    assert table.pictures["paper"]["0"].shape == (16, 16)
    assert table.pictures["paper"]["0"].any()


def test_images_that_cannot_be_read(tmp_path: Path, calls: list[str]) -> None:
    of = examples([0])
    of.failed["bad"] = "no image"
    table = run_table2(tmp_path, of, [NEAR], Table2Settings(), workers=1)
    assert table.failures == [Failure("bad", None, "no image")]
    assert table.lines()[1].accuracy["interval", 4].n == 1


def _harder(folder: Path, *methods: PoseMethod) -> Table2:
    conditions = {"sides-5": examples([40, 350], prefix="sides-5/"), "no-box": examples([90], prefix="no-box/")}
    return run_table2(folder, examples(AZIMUTHS), methods, Table2Settings(), conditions, workers=1)


def test_conditions_have_tables_of_their_own(tmp_path: Path, calls: list[str]) -> None:
    """8° more: 40° leaves the first of 4 views, 350° does not."""
    table, plain = _harder(tmp_path, NEAR), _made(tmp_path / "plain", NEAR)
    assert [line.accuracy for line in table.lines()] == [line.accuracy for line in plain.lines()]
    (line,) = table.under("sides-5").ran()
    assert (line.accuracy["interval", 4].mean, line.accuracy["interval", 8].mean, line.error.n) == (50, 100, 2)
    assert table.under("no-box").ran()[0].error.median == pytest.approx(8, abs=1e-4)
    assert table.under("no-box").ran()[0].seconds == table.seconds["paper"]["no-box/0"]
    assert set(table.pictures["paper"]) == set("0123")  # the page shows those of the table


def test_files_of_conditions(tmp_path: Path, calls: list[str]) -> None:
    table = _harder(tmp_path, FAR, NEAR)
    write_table2(tmp_path, table, Table2Settings(7))
    assert sorted(os.listdir(tmp_path)) == ["conditions.csv", *FILES, "work"]
    rows = _rows(tmp_path / "conditions.csv")
    assert list(rows[0]) == ["condition", "method", "objects", "figure", "value", "low", "high"]
    of = {(row["condition"], row["method"], row["figure"]): row["value"] for row in rows}
    assert len(of) == len(rows) == 2 * 2 * 12
    assert of["sides-5", "paper", "interval_4"] == "50.0"
    assert of["no-box", "paper", "threshold_24"] == "100.0"
    assert float(of["no-box", "exemplar", "azimuth_median_error"]) == pytest.approx(100, abs=1e-4)
    assert of["no-box", "paper", "rotation_within_30_degrees"] == "100.0"
    objects = [row["object"] for row in _rows(tmp_path / "per_object.csv") if row["method"] == "paper"]
    assert objects == ["0", "1", "2", "3", "sides-5/0", "sides-5/1", "no-box/0"]

    results = json.loads((tmp_path / "results.json").read_text())
    assert (results["seed"], results["origin"], list(results["conditions"])) == (7, "Made up.", ["sides-5", "no-box"])
    assert [line["method"] for line in results["table"]] == ["exemplar", "paper"]
    assert results["table"][1]["interval"]["4"]["value"] == 75
    assert results["table"][1]["paper"]["4"] == 58.85
    exemplar, paper = results["conditions"]["sides-5"]["table"]
    assert (exemplar["interval"]["4"]["value"], paper["interval"]["4"]["value"], paper["objects"]) == (0, 50, 2)
    assert results["conditions"]["no-box"]["about"].startswith("There is no box")
    assert results["failures"] == [{"image": "0", "method": "exemplar", "reason": "no element"}]

    write_table2(tmp_path, _made(tmp_path, NEAR), Table2Settings())  # now without conditions
    assert sorted(os.listdir(tmp_path)) == [*FILES, "work"]


def test_conditions_are_resumed(tmp_path: Path, calls: list[str]) -> None:
    first = _harder(tmp_path, NEAR)
    assert calls == ["paper"] * 7
    calls.clear()
    again = _harder(tmp_path, NEAR)
    assert calls == []
    assert again.figures == first.figures
