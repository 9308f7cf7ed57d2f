"""All that both tables write of methods whose results are known."""

from __future__ import annotations

import re

import numpy as np
import pytest

from .stored_tables import STORED, texts

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-\d+)?")


@pytest.mark.slow
def test_files_pages_and_the_terminal() -> None:
    """Numbers up to rounding; ``python -m tests.paper.stored_tables`` writes what is stored."""
    for name, text in texts().items():
        expected = (STORED / name).read_text()
        assert NUMBER.sub("0", text) == NUMBER.sub("0", expected)
        figures, stored = (np.array(NUMBER.findall(each), dtype=float) for each in (text, expected))
        np.testing.assert_allclose(figures, stored, rtol=1e-6, atol=1e-9)
