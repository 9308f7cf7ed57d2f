"""Numbers of other libraries are taken as Python's own."""

from __future__ import annotations

import numpy as np

from nablahog.inputs.boxes import as_box
from nablahog.inputs.numbers import as_integer, as_size, parse_numbers


def test_numbers() -> None:
    assert as_integer("bins", np.int64(9)) == 9
    assert as_size("image_size", [48, np.uint8(64)]) == (48, 64)
    assert as_box("box", np.array([1.5, 2, 30, 40])) == (1.5, 2, 30, 40)
    assert [parse_numbers(text) for text in ("7", "1,-2.5", "[3, 4]", "a,b")] == [7, (1, -2.5), (3, 4), "a,b"]
