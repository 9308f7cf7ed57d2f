"""The short profile of killed commands."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from . import kills
from .kills import Case


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    kills.close()


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_killed_commands() -> None:
    for case in (Case("hog", (0.3,)), Case("hog", (0.6, 0.9)), Case("hoggles", (0.5, 0.8))):
        kills.check(case)
