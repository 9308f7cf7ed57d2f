"""Many random cases in parts that run side by side, each from a seed of its own: the number of the part."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, Phase, given, note, seed, settings
from hypothesis.strategies import SearchStrategy

Case = TypeVar("Case")
FIRST = int(os.environ.get("NABLAHOG_FUZZ_SEED", "0"))
parts = pytest.mark.parametrize("part", range(FIRST, FIRST + int(os.environ.get("NABLAHOG_FUZZ", "1"))))
LONGEST_MESSAGE = 1000  # characters of a clear sentence


def check_sentence(message: str) -> None:
    """A refusal is one printable sentence of sensible length."""
    assert message.strip(), "refused without a word"
    assert len(message) <= LONGEST_MESSAGE, f"refused in {len(message):,} characters: {message[:200]!r} …"
    assert "Traceback" not in message and message.isprintable(), f"refused with {message[:300]!r}"  # noqa: PT018


def examine(check: Callable[[Case], str], cases: SearchStrategy[Case], count: int, part: int) -> Counter[str]:
    """Checks so many random cases, and counts what ``check`` says of them; the first fault ends it."""
    outcomes: Counter[str] = Counter()

    @seed(part)
    @settings(max_examples=count, database=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    @given(cases)
    def run(case: Case) -> None:
        note(repr(case))
        outcomes[check(case)] += 1

    run()
    return outcomes
