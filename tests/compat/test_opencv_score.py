"""The score of a window and its derivative by the image."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage import data

from nablahog.compat.opencv import HOGDescriptor, score

SMALL = ((16, 24), (8, 8), (4, 8), (4, 4), 6)


def descriptor(*, bias: bool = True) -> HOGDescriptor:
    small = HOGDescriptor(*SMALL)
    weights = np.random.default_rng(0).standard_normal(small.getDescriptorSize() + bias)
    small.setSVMDetector(weights.astype(np.float32) / 4)
    return small


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("bias", [False, True])
def test_it_is_the_weight_of_detect(colour: bool, bias: bool) -> None:
    image = data.astronaut()[100:124, 200:216, : 3 if colour else 1]
    (weight,) = descriptor(bias=bias).detect(image, hitThreshold=-99)[1]
    pixels = torch.from_numpy(image.copy()).permute(2, 0, 1).unsqueeze(0)
    for images in (pixels, pixels / 255, pixels.double() / 255):
        assert float(score(images, descriptor(bias=bias))) == pytest.approx(weight, abs=2e-5)
        assert float(score(images, descriptor(bias=bias), "exact")) == pytest.approx(weight, abs=5e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_its_derivative(channels: int) -> None:
    images = torch.rand(2, channels, 24, 16, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    images.requires_grad_()
    small = descriptor()
    assert torch.autograd.gradcheck(lambda x: score(x, small, "exact"), images, eps=1e-7, atol=1e-5)
    (ours,) = torch.autograd.grad(score(images, small).sum(), images)
    (exact,) = torch.autograd.grad(score(images, small, "exact").sum(), images)
    assert float((ours - exact).abs().max()) < 0.02 * float(exact.abs().max())  # of the polynomial's value only


def test_refusals() -> None:
    with pytest.raises(ValueError, match="the descriptor has no detector"):
        score(torch.zeros(1, 1, 24, 16), HOGDescriptor(*SMALL))
    with pytest.raises(ValueError, match=r"images must be \(B, C, 24, 16\).* got \(1, 1, 16, 24\)"):
        score(torch.zeros(1, 1, 16, 24), descriptor())
    with pytest.raises(TypeError, match="a torch tensor"):
        score(np.zeros((24, 16)), descriptor())  # type: ignore[arg-type]
