"""What stands in for other libraries, called as they are."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from nablahog.compat.opencv import HOGDescriptor
from nablahog.compat.skimage import hog


def test_as_scikit_image() -> None:
    """A column of bright pixels in one cell: a vote to the right, one to the left, and √(a² + a²) = 1."""
    image = np.zeros((8, 8))
    image[:, 4] = 1
    descriptor = hog(image, orientations=2, pixels_per_cell=(8, 8), cells_per_block=(1, 1), block_norm="L2")
    assert_allclose(descriptor, [1, 0], atol=1e-6)


def test_as_opencv() -> None:
    """The window of pedestrians: 15 · 7 blocks of 4 cells of 9 bins; and a constant image has no gradient."""
    descriptor = HOGDescriptor().compute(np.full((128, 64), 90, np.uint8))
    assert descriptor.shape == (3780,)
    assert not descriptor.any()
