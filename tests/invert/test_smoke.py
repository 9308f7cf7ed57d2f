"""An image from its descriptor."""

from __future__ import annotations

import torch

from nablahog import hog, presets, reconstruct
from nablahog.metrics import cross_correlation


def test_a_bright_square() -> None:
    image = torch.zeros(1, 1, 32, 32)
    image[..., 8:24, 8:24] = 1
    result = reconstruct(hog(image, presets.uoctti(8)), presets.uoctti(8), quality="fast", prior=None)
    assert result.image.shape == (1, 1, 32, 32)
    assert result.distance[0] < 0.3  # of its descriptor, relative
    assert cross_correlation(result.image[0, 0], image[0, 0]) > 0.7
