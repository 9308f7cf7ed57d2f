"""One loop of the library, by its C interface."""

from __future__ import annotations

import numpy as np
import pytest

from nablahog import native
from nablahog.hog.kernels.loops import add_energy

needs_loops = pytest.mark.skipif(not native.available(), reason="there are no compiled loops")


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_loops), False])
def test_a_loop(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what stands in for it where there are none."""
    monkeypatch.setattr(native, "available", lambda: compiled)
    assert add_energy(np.array([3.0, 4.0]), 0.5) == 25.5
