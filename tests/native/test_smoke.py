"""One loop of the library, by its C interface."""

from __future__ import annotations

import numpy as np
import pytest

from nablahog import native
from nablahog.hog.kernels.loops import add_energy


@pytest.mark.skipif(not native.available(), reason="there are no compiled loops")
def test_a_loop() -> None:
    assert add_energy(np.array([3.0, 4.0]), 0.5) == 25.5
