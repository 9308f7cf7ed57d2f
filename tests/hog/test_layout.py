"""Layouts: what is where, there and back, and the shapes that are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.layout import from_layout, native_shape, to_layout

from .zoo import PRESETS, SPECS, integers

SIZE = (29, 26)
names = pytest.mark.parametrize("name", SPECS)


def numbered(s: HOGSpec, size: tuple[int, int], batch: int = 2) -> Tensor:
    """Descriptors, each entry of which is its own index."""
    shape = (batch, *s.grid(*size), s.channels)
    return torch.arange(math.prod(shape)).reshape(shape)


@names
def test_native_layout_is_the_descriptor_laid_out(name: str) -> None:
    s, image = SPECS[name], integers(1, 3, *SIZE)
    assert torch.equal(hog(image, s, layout="native"), to_layout(hog(image, s, layout="cells"), s))
    assert torch.equal(hog(image, s), hog(image, s, layout="cells"))


@given(name=st.sampled_from(sorted(SPECS)), rows=st.integers(1, 5), cols=st.integers(1, 5), batch=st.integers(0, 3))
def test_there_and_back(name: str, rows: int, cols: int, batch: int) -> None:
    s = SPECS[name]
    size = s.image_size(rows, cols)
    descriptor = numbered(s, size, batch)
    native = to_layout(descriptor, s)
    assert native.shape == (batch, *native_shape(s, size))
    assert torch.equal(from_layout(native, s, size), descriptor)
    assert torch.equal(from_layout(native.flatten(1), s, size), descriptor)
    assert torch.equal(to_layout(from_layout(native, s, size), s), native)


def test_planes() -> None:
    """VLFeat and dlib: the channel first."""
    for s in (presets.vlfeat(), presets.dlib(), presets.cnn_hog()):
        descriptor = numbered(s, (40, 56))
        native = to_layout(descriptor, s)
        assert native.shape[1] == s.channels
        for row, col, channel in ((0, 0, 0), (1, 2, 5), (2, 1, 20)):
            assert native[1, channel, row, col] == descriptor[1, row, col, channel]


def test_colour_planes() -> None:
    """MaskFeat: colour, bin, row, column."""
    s = presets.maskfeat(nbins=7)
    descriptor = numbered(s, (24, 32))
    native = to_layout(descriptor, s)
    assert native.shape == (2, 3, 7, 3, 4)
    for colour, bin_, row, col in ((0, 0, 0, 0), (1, 3, 2, 1), (2, 6, 0, 3)):
        assert native[1, colour, bin_, row, col] == descriptor[1, row, col, 7 * colour + bin_]


def test_blocks_of_skimage() -> None:
    """Block row, block column, cell row, cell column, bin; in one row if a feature vector is asked for."""
    s = presets.skimage(5, (8, 6), (2, 3), feature_vector=False)
    descriptor = numbered(s, (32, 36))
    native = to_layout(descriptor, s)
    assert native.shape == (2, 3, 4, 2, 3, 5)
    for row, col, y, x, bin_ in ((0, 0, 0, 0, 0), (2, 1, 1, 0, 4), (1, 3, 0, 2, 1)):
        assert native[1, row, col, y, x, bin_] == descriptor[1, row, col, (3 * y + x) * 5 + bin_]
    vector = to_layout(descriptor, presets.skimage(5, (8, 6), (2, 3), feature_vector=True))
    assert np.array_equal(vector[1].numpy(), native[1].numpy().ravel())


def test_vectors_of_opencv() -> None:
    """Column by column of blocks, in a block column by column of cells."""
    s = presets.opencv((64, 48), (16, 24), (8, 8), (8, 8), 5)
    descriptor = numbered(s, (48, 64))
    native = to_layout(descriptor, s).reshape(2, 7, 4, 2, 3, 5)
    for col, row, x, y, bin_ in ((0, 0, 0, 0, 0), (6, 1, 1, 2, 4), (3, 3, 0, 1, 2)):
        assert native[1, col, row, x, y, bin_] == descriptor[1, row, col, (2 * y + x) * 5 + bin_]


def test_patches_of_maskfeat() -> None:
    """The k-th entry of a patch: its channel first, then its row, then its column of cells."""
    s = presets.maskfeat(nbins=4, layout="tokens")
    descriptor = numbered(s, (32, 48))  # 4 x 6 cells of 12 channels
    native = to_layout(descriptor, s)
    assert native.shape == (2, 6, 48)
    for patch, channel, y, x in ((0, 0, 0, 0), (4, 3, 1, 0), (2, 11, 0, 1), (5, 7, 1, 1)):
        row, col = 2 * (patch // 3) + y, 2 * (patch % 3) + x
        assert native[1, patch, 4 * channel + 2 * y + x] == descriptor[1, row, col, channel]
    torch.testing.assert_close(from_layout(native, s, (32, 48)), descriptor)
    for refused in (lambda: native_shape(s, (40, 48)), lambda: to_layout(numbered(s, (32, 40)), s)):
        with pytest.raises(ValueError, match="'tokens' needs even numbers of rows and columns of cells, got"):
            refused()


@pytest.mark.parametrize("name", PRESETS)
def test_refuses_other_shapes(name: str) -> None:
    """All of which have as many entries as some descriptor, but not laid out as the library's."""
    s = PRESETS[name]()
    size = s.image_size(3, 4)
    right = native_shape(s, size)
    for shape in {(*right, 1), right[:-1], (math.prod(right) + 1,), (4, 3, s.channels)} - {right}:
        with pytest.raises(ValueError, match=r"descriptor of an image of .* has the shape"):
            from_layout(torch.zeros(2, *shape), s, size)
