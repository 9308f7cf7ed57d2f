"""The descriptor of an edge, in numbers."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from nablahog import hog, presets


def test_an_edge() -> None:
    """From dark to bright at column 16: a cell beside it has votes in one direction alone, and is clipped at 0.2."""
    image = torch.zeros(1, 1, 32, 32)
    image[..., 16:] = 1
    descriptor = hog(image, presets.uoctti(8))
    assert descriptor.shape == (1, 4, 4, 31)  # rows, columns, 18 directions and 9 orientations and 4 textures
    expected = torch.zeros(31)
    expected[[0, 18]] = 0.4  # ½ · 4 blocks · 0.2
    expected[27:] = 0.2357 * 0.2
    assert_close(descriptor[0, 1, 1], expected, rtol=1e-3, atol=1e-6)
    assert not descriptor[0, :, 0].any()  # a cell further away has none


def test_its_gradient() -> None:
    """A constant image is a kink, where the derivative is 0."""
    image = torch.full((1, 1, 32, 32), 0.5, requires_grad=True)
    hog(image, presets.uoctti(8)).sum().backward()
    assert image.grad is not None
    assert image.grad.eq(0).all()
