"""From results to tables: formats, failures, reuse."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from nablahog.paper.table1 import METRICS, write_table1
from nablahog.paper.tables import Failure, spread_evenly, statistics

from .common import made, photographs
from .fakes import BRIGHT, DARK, LEVELS, MISTAKEN, UNDEFINED

FILES = ["failures.csv", "per_image.csv", "summary.csv", "times.csv"]


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_files(tmp_path: Path, calls: list[str]) -> None:
    table = made(tmp_path, photographs(), BRIGHT, LEVELS)
    write_table1(tmp_path, table)
    assert sorted(os.listdir(tmp_path)) == [*FILES, "work"]

    rows = _rows(tmp_path / "per_image.csv")
    assert list(rows[0]) == ["method", "image", *METRICS]
    named = [(row["method"], row["image"]) for row in rows]
    assert named == [(row, f"{k}.png") for row in (*BRIGHT.rows, *LEVELS.rows) for k in range(3)]
    for row in rows:
        figures = table.figures[row["method"]][row["image"]]
        values = [float(row[metric]) if row[metric] else None for metric in METRICS]
        assert values == [figures[metric] for metric in METRICS]  # to the last bit

    summary = {(row["method"], row["metric"]): row for row in _rows(tmp_path / "summary.csv")}
    assert list(summary["uoctti-single", "cc"]) == ["method", "metric", "mean", "median", "low", "high", "paper", "n"]
    line = summary["uoctti-single", "ssim"]
    values = [table.figures["uoctti-single"][f"{k}.png"]["ssim"] or 0 for k in range(3)]
    of = statistics(values)
    assert [float(line[key]) for key in ("mean", "median", "low", "high")] == [of.mean, of.median, of.low, of.high]
    assert (line["paper"], line["n"]) == ("0.433", "3")
    assert summary["dalal-multi-scale@1/4", "mi"]["paper"] == "1.458"
    assert summary["dalal-multi-scale", "distance"]["paper"] == ""
    assert not {("dalal-single", "cc"), ("bovw", "cc")} & {*summary}  # not asked for

    times = _rows(tmp_path / "times.csv")
    assert [(row["method"], row["image"]) for row in times] == [
        (name, f"{k}.png") for name in ("uoctti-single", "dalal-multi-scale") for k in range(3)
    ]
    assert (tmp_path / "failures.csv").read_text() == "image,method,reason\n"


def test_order_and_groups(tmp_path: Path, calls: list[str]) -> None:
    lines = made(tmp_path, photographs(1), BRIGHT, LEVELS, UNDEFINED).table_rows()
    expected = [*BRIGHT.rows, *LEVELS.rows, "undefined"]
    assert [line.row for line in lines] == expected
    by_row = {line.row: line for line in lines}
    assert by_row["dalal-multi-scale@1/4"].seconds is None
    assert by_row["dalal-multi-scale"].seconds is not None
    assert by_row["undefined"].statistics["distance"].n == 0
    assert by_row["undefined"].statistics["cc"].n == 1
    assert by_row["undefined"].statistics["psnr"].n == 0  # equal images have none


def test_failures(tmp_path: Path, calls: list[str]) -> None:
    some = photographs(2)
    some.images["0.png"] = some.images["0.png"][:30].contiguous()
    some.failed["bad,\n.png"] = "no image"
    table = made(tmp_path, some, LEVELS, MISTAKEN, DARK)
    where = table.failures[2].reason
    assert where.startswith("KeyError at fakes.py:")
    assert table.failures == [
        Failure("bad,\n.png", None, "no image"),
        Failure("0.png", "dalal-multi-scale", "no scale 1/64"),
        Failure("0.png", "mistaken", where),
        Failure("1.png", "mistaken", where),
    ]
    counts = {line.row: line.statistics["cc"].n for line in table.table_rows()}
    assert (counts["dark"], counts["dalal-multi-scale@1/4"], counts["mistaken"]) == (2, 1, 0)
    write_table1(tmp_path, table)
    rows = _rows(tmp_path / "failures.csv")
    assert rows[0] == {"image": r"bad,\n.png", "method": "", "reason": "no image"}
    assert len(rows) == 4


def test_done_once(tmp_path: Path, calls: list[str]) -> None:
    first = made(tmp_path, photographs(), DARK, MISTAKEN)
    assert sorted(calls) == ["dark"] * 3 + ["mistaken"] * 3
    calls.clear()
    second = made(tmp_path, photographs(), DARK, MISTAKEN)
    assert calls == ["mistaken"] * 3  # failures are no results
    assert second.figures == first.figures
    assert second.seconds == first.seconds
    calls.clear()
    made(tmp_path, photographs(4), DARK, BRIGHT)
    assert sorted(calls) == ["dark"] + ["uoctti-single"] * 4


@pytest.mark.parametrize("count", [0, 6, 101])
def test_evenly_spread(count: int) -> None:
    names = [str(k) for k in range(count)]
    shown = spread_evenly(names, 6)
    assert len(shown) == min(6, count) == len(set(shown))
    assert shown == sorted(shown, key=int)
    assert np.all(np.diff([int(name) for name in shown]) >= count // 6)
