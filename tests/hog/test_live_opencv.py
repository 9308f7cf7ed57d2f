"""OpenCV's own HOGDescriptor, here and now, with any parameters on any small image of bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from nablahog.hog import hog, presets

cv2: Any = pytest.importorskip("cv2")

THRESHOLD = 0.2  # no other: OpenCV keeps the first one of a process for all descriptors to come
# Both work in float32, but OpenCV fuses products and sums where a processor can.  Votes near the end of a turn of 18
# bins are rounded to 2e-6 of a bin; where a block has few of them, a second normalisation makes them five times as
# large.
TOLERANCE = 1e-5

Bytes = npt.NDArray[np.uint8]


def picture(seed: int, size: tuple[int, int], colours: int, levels: int) -> Bytes:
    """Noise of so many levels, of which few make many ties."""
    drawn = np.random.default_rng(seed).integers(0, levels, (*size, colours)) * (255 // (levels - 1))
    return drawn.astype(np.uint8)


def theirs(image: Bytes, sizes: tuple[tuple[int, int], ...], bins: int, sigma: float, gamma: bool, signed: bool) -> Any:
    descriptor = cv2.HOGDescriptor(*sizes, bins, 1, sigma, 0, THRESHOLD, gamma, 64, signed)
    return descriptor.compute(image if image.shape[2] == 3 else np.ascontiguousarray(image[..., 0])).ravel()


def ours(image: Bytes, sizes: tuple[tuple[int, int], ...], bins: int, sigma: float, gamma: bool, signed: bool) -> Any:
    spec = presets.opencv(*sizes, bins, win_sigma=sigma, gamma=gamma, signed=signed)  # type: ignore[arg-type]
    return hog(torch.from_numpy(image).permute(2, 0, 1).unsqueeze(0), spec, layout="native")[0].numpy()


two = st.tuples(st.integers(2, 9), st.integers(2, 9))
few = st.tuples(st.integers(1, 3), st.integers(1, 3))


@given(
    cell=two,
    cells=few,
    stride=two,
    more=st.tuples(st.integers(0, 3), st.integers(0, 3)),
    bins=st.integers(3, 18),
    sigma=st.sampled_from([-1.0, -1.0, 0.0, 1.5, 7.0]),
    gamma=st.booleans(),
    signed=st.booleans(),
    colours=st.sampled_from([1, 3]),
    levels=st.sampled_from([2, 3, 4, 8, 16, 256]),
    seed=st.integers(0, 2**31 - 1),
)
@settings(max_examples=60)
@example((8, 8), (2, 2), (8, 8), (3, 3), 9, -1.0, True, False, 3, 256, 0)
@example((8, 8), (2, 2), (8, 8), (3, 3), 9, -1.0, True, False, 3, 3, 1)
@example((7, 5), (1, 2), (3, 4), (3, 2), 18, -1.0, False, True, 3, 2, 2)
def test_equals_opencv(
    cell: tuple[int, int],
    cells: tuple[int, int],
    stride: tuple[int, int],
    more: tuple[int, int],
    bins: int,
    sigma: float,
    gamma: bool,
    signed: bool,
    colours: int,
    levels: int,
    seed: int,
) -> None:
    """The window is the image: a block and some strides."""
    assume(bins * cells[0] * cells[1] >= 4)  # of fewer, OpenCV reads four numbers at a time, and crashes
    block = cell[0] * cells[0], cell[1] * cells[1]
    window = block[0] + more[0] * stride[0], block[1] + more[1] * stride[1]
    image, sizes = picture(seed, window[::-1], colours, levels), (window, block, stride, cell)
    expected = theirs(image, sizes, bins, sigma, gamma, signed)
    result = ours(image, sizes, bins, sigma, gamma, signed)
    assert result.shape == expected.shape
    assert result.dtype == expected.dtype
    np.testing.assert_allclose(result, expected, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("width", range(16, 24))
def test_ties_of_colours_in_the_last_columns(width: int) -> None:
    """Two levels: most pixels tie, and the last width % 4 columns choose another channel."""
    for seed in range(5):
        image = picture(seed, (16, width), 3, 2)
        sizes = ((width, 16), (width, 16), (8, 8), (width, 16))
        expected = theirs(image, sizes, 9, -1.0, False, True)
        np.testing.assert_allclose(ours(image, sizes, 9, -1.0, False, True), expected, rtol=0, atol=TOLERANCE)
