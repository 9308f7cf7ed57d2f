"""Figures of a table."""

from __future__ import annotations

from nablahog.paper.tables import Failure, failures_section, spread_evenly, statistics


def test_statistics() -> None:
    summary = statistics([1.0, 2.0, 6.0])
    assert (summary.mean, summary.median, summary.n) == (3.0, 2.0, 3)
    assert (summary.low, summary.high) == (1.0, 6.0)  # one resample of 27 is 1, 1, 1: more than 2.5 %


def test_images_of_a_page() -> None:
    assert spread_evenly(["a", "b", "c", "d", "e"], 2) == ["a", "c"]
    assert spread_evenly(["a", "b"], 3) == ["a", "b"]


def test_failures_of_a_page() -> None:
    section = failures_section([Failure("a.png", None, "no memory")], "image", "they count as 0")
    assert (section.heading, section.text) == ("Failed: 1", "they count as 0")
    assert section.table == [{"image": "a.png", "method": "all", "reason": "no memory"}]
