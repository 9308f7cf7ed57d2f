"""Layouts: what is where, there and back, the shapes that are refused; and what channels are."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.hog.layout import channel_names, from_layout, native_shape, to_layout

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


@pytest.mark.slow
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
    for one in (lambda: from_layout(torch.zeros(right), s, size), lambda: to_layout(torch.zeros(3, 4, s.channels), s)):
        with pytest.raises(ValueError, match=r"must have|has the shape \(B, .*: write descriptor\[None\]$"):
            one()


@pytest.mark.parametrize("name", presets.__all__)
def test_each_channel_has_a_name_of_its_own(name: str) -> None:
    spec = DEFAULT_SPECS[name]
    names = channel_names(name)
    assert len(names) == len({*names}) == spec.channels


def test_names_say_what_a_channel_is() -> None:
    assert channel_names("paper")[:2] == ("10°", "30°")
    assert channel_names("opencv")[-1] == "cell 1, 1 of the block: 170°"
    assert channel_names("dpm")[27:] == (
        *(f"texture: block {block}" for block in ("down-right", "up-right", "down-left", "up-left")),
        "always 0",
    )
    assert channel_names("maskfeat")[9] == "green, 80°"
