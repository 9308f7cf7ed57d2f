"""A picture of a descriptor."""

from __future__ import annotations

import torch

from nablahog import glyphs, presets


def test_glyphs() -> None:
    """One cell with a vote for a gradient to the right: an upright stroke in it, and nothing elsewhere."""
    descriptor = torch.zeros(2, 3, 31)
    descriptor[0, 1, 18] = 1
    picture = glyphs(descriptor, presets.uoctti(8), cell_pixels=5)
    assert picture.shape == (10, 15)
    assert (picture[1:4, 7] == 1).all()
    picture[:5, 5:10] = 0
    assert not picture.any()
