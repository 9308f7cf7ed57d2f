"""Detection beside stored outputs of OpenCV, where OpenCV is not installed, too: see ``tests/golden/README.md``."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from nablahog.compat.opencv import HOGDescriptor
from tests.golden import archive

STORED = archive("opencv_detection")
CASES = json.loads(str(STORED["cases"]))


@pytest.mark.parametrize("number", range(len(CASES)))
def test_detections_are_the_stored_ones(number: int) -> None:
    options = dict(CASES[number])
    descriptor = HOGDescriptor(*json.loads(str(STORED["sizes"])))
    descriptor.setSVMDetector(STORED["detector"])
    rectangles, weights = descriptor.detectMultiScale(archive("images")[options.pop("image")], **options)
    expected = STORED[f"rectangles_{number}"]
    assert len(rectangles) == len(expected) > 0
    assert_array_equal(rectangles, expected)
    assert np.abs(weights - STORED[f"weights_{number}"]).max() <= 1e-5
