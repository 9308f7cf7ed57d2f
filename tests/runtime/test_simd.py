"""Memory for vector instructions."""

from __future__ import annotations

import numpy as np
import pytest

from nablahog.runtime.simd import PADDING, aligned_zeros, whole_vectors


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
@pytest.mark.parametrize("count", [0, 1, 17, 4099])
def test_planes_begin_with_a_cache_line(count: int, dtype: type) -> None:
    plane = aligned_zeros(count, dtype)
    assert (plane.shape, plane.dtype) == ((count,), dtype)
    assert count == 0 or plane.ctypes.data % 64 == 0
    assert plane.flags.writeable
    assert not plane.any()


def test_whole_vectors() -> None:
    assert [whole_vectors(n) for n in (0, 1, PADDING, PADDING + 1)] == [0, PADDING, PADDING, 2 * PADDING]
