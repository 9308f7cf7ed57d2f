"""The short profile of damaged caches."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from . import caches
from .harness import campaign


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    caches.close()


def test_damaged_caches() -> None:
    report = campaign(caches.check, caches.cases, 12, 1)
    assert report.cases == 12
    assert not report.faults
