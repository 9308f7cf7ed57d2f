"""Mean, median and bootstrap interval."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import bootstrap, norm

from nablahog.paper.tables import Statistics, interval, statistics, write_csv


def test_an_interval_of_the_mean() -> None:
    """Against SciPy's percentile bootstrap of skewed values, and the normal distribution's 1.96 standard errors."""
    values = np.random.default_rng(2).exponential(1, 101)
    low, high = interval(values, np.mean)
    expected = bootstrap([values], np.mean, n_resamples=20_000, method="percentile", rng=1).confidence_interval
    assert (low, high) == pytest.approx(tuple(expected), abs=0.02 * (high - low))
    many = np.random.default_rng(4).normal(3, 1, 2_000)
    reach = norm.ppf(0.975) * many.std() / math.sqrt(len(many))
    ends = many.mean() - reach, many.mean() + reach
    assert interval(many, np.mean) == pytest.approx(ends, abs=0.05 * reach)


def test_few_values() -> None:
    assert statistics([]) == Statistics(None, None, None, None, 0)
    assert statistics([0.3]) == Statistics(0.3, 0.3, 0.3, 0.3, 1)


def test_an_interval_of_the_median() -> None:
    """Against the order statistics that hold the median of 101 values with 95 %."""
    values = np.sort(np.random.default_rng(3).exponential(1, 101))
    low, high = interval(values, np.median)
    assert values[38] <= low <= values[42]
    assert values[58] <= high <= values[62]
    assert interval(values, np.mean) == (statistics(values.tolist()).low, statistics(values.tolist()).high)


def test_no_text_in_a_table_is_a_formula(tmp_path: Path) -> None:
    texts = ["=1+1", "+1", "-1", "@a", "＝1", "a=1", "", "'"]
    write_csv(tmp_path / "a.csv", [("image", "error"), *((text, -1.5) for text in texts), (None, -2)])
    with open(tmp_path / "a.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    assert [row[0] for row in rows] == [*(f"'{text}" for text in texts[:5]), *texts[5:], ""]
    assert [row[1] for row in rows] == ["-1.5"] * len(texts) + ["-2"]


def test_no_text_in_a_table_is_another_row(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", [("a\r=1+1", 1), ("\t=1", 2), ("\n=1", 3), ("\x1b[31m", 4)])
    assert (tmp_path / "a.csv").read_text() == "a\\r=1+1,1\n\\t=1,2\n\\n=1,3\n\\x1b[31m,4\n"
