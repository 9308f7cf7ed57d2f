"""The short profile of :mod:`.operator`."""

from __future__ import annotations

import pytest

from .corpus import stored_cases
from .harness import campaign
from .operator import Case, cases, check


@pytest.mark.parametrize("case", stored_cases("operator", Case))
def test_cases_that_once_failed(case: Case) -> None:
    check(case)


def test_random_cases() -> None:
    assert campaign(check, cases, count=120, number=0).faults == []
