"""No worker processes, unless a test is about them."""

from __future__ import annotations

import pytest

from .common import run_in_this_process


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Runs jobs in this process, and lists the methods of those that were begun."""
    begun: list[str] = []
    run_in_this_process(monkeypatch, lambda job: begun.append(job.folder))
    return begun
