"""What :mod:`.generated` writes is what it would write now."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests import generated


@pytest.mark.parametrize("make", [generated.stubs, generated.others])
def test_nothing_generated_is_stale(make: Callable[[], dict[Path, str]]) -> None:
    stale = [str(path.relative_to(generated.ROOT)) for path, text in make().items() if path.read_text("utf-8") != text]
    assert not stale, f"{', '.join(stale)}: run `make generated`; if a public name has changed, say so in CHANGELOG.md"
