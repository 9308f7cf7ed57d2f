"""The groups of options say what is out of range."""

from __future__ import annotations

from typing import Any

import pytest

from nablahog.invert import Objective, Search
from nablahog.invert.priors import TotalVariation


@pytest.mark.parametrize(
    ("group", "options", "says"),
    [
        (Search, {"basis": "wavelets"}, "basis must be one of 'cosine', 'pixels', got 'wavelets'"),
        (Search, {"minimiser": "newton"}, "must be one of 'lbfgs', 'dogleg', got 'newton'"),
        (Search, {"max_evaluations": 1}, r"max_evaluations must be at least 2.*got 1"),
        (Search, {"samples": 0}, "samples must be at least 1, got 0"),
        (Objective, {"smoothness": -1.0}, "smoothness.*at least 0, got -1"),
        (Objective, {"smoothness": float("nan")}, "smoothness.*finite"),
        (Objective, {"closeness": -0.1}, "closeness.*at least 0, got -0.1"),
        (Objective, {"closeness": float("nan")}, "closeness.*finite"),
        (Objective, {"closeness": float("inf")}, "closeness.*finite"),
    ],
)
def test_out_of_range(group: type[Any], options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        group(**options)


def test_priors_are_a_list() -> None:
    one = TotalVariation(0.1)
    assert Objective(priors=[one]) == Objective(priors=(one,))
    for wrong in (one, [0.1], "smooth"):
        with pytest.raises(TypeError, match="priors must be a list of priors, got"):
            Objective(priors=wrong)  # type: ignore[arg-type]
