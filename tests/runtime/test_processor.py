"""Levels of processors."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from numba.core import config

from nablahog.runtime import processor
from nablahog.runtime.processor import LEVELS, level, levels, vector_bytes
from nablahog.runtime.simd import lanes


@pytest.fixture
def _uncached() -> Iterator[None]:
    def clear() -> None:
        vector_bytes.cache_clear()
        level.cache_clear()

    clear()
    yield
    clear()


@pytest.mark.usefixtures("_uncached")
@pytest.mark.parametrize(
    ("features", "has", "takes", "single"),
    [
        (LEVELS[0].features, ["x86-64-v4", "x86-64-v3"], "x86-64-v4", 16),
        ((*LEVELS[1].features, "aes"), ["x86-64-v3"], "x86-64-v3", 8),
        (LEVELS[1].features[1:], [], None, 8),
        # wide vectors, but not all of the level: code for narrow ones is not for its loops
        ((*LEVELS[1].features, "avx512f"), ["x86-64-v3"], None, 16),
        (LEVELS[2].features, ["generic"], "generic", 8),
    ],
)
def test_which_levels(
    monkeypatch: pytest.MonkeyPatch, features: tuple[str, ...], has: list[str], takes: str | None, single: int
) -> None:
    monkeypatch.setattr(config, "CPU_FEATURES", ",".join(f"+{each}" for each in features) + ",-sse4a")
    assert [each.name for each in levels()] == has
    its_own = level()
    assert (its_own.name if its_own else None) == takes
    assert lanes(4) == 2 * lanes(8) == single


@pytest.mark.parametrize("each", LEVELS)
def test_numba_is_told_all(each: processor.Level) -> None:
    variables = each.environment()
    assert variables["NUMBA_CPU_NAME"] == each.name
    assert variables["NUMBA_CPU_FEATURES"].replace("+", "").split(",") == list(each.features)
