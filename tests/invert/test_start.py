"""Where the search begins: integrated votes, noise, and their contrast."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from nablahog.hog import HOGSpec, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.gradient import gradient
from nablahog.invert.histograms import at_contrast, in_pairs, integrate, mean_gradient, noise, starting_images
from nablahog.invert.reconstruction import to_unit_range

from .photographs import photograph

LIKE = torch.zeros(1, dtype=torch.float64)
BOTH = pytest.mark.parametrize("spec", [presets.uoctti(8), presets.paper(8)], ids=["signed", "unsigned"])


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


def test_mean_gradient_of_a_ramp_is_its_slope() -> None:
    spec = presets.uoctti(8)
    ramp = (torch.arange(64.0).expand(64, 64) / 255)[None, None]
    gx, gy = mean_gradient(histograms(ramp, spec), spec, 64, 64)
    # the ring of silent pixels is missing at the border; inside it is exact
    torch.testing.assert_close(gx[0, 16:-16, 16:-16], torch.full((32, 32), 2.0))
    assert gy.abs().max() < 1e-4


def test_integration_inverts_the_gradient_of_a_smooth_image() -> None:
    y, x = torch.meshgrid(torch.linspace(0, 3, 48), torch.linspace(0, 4, 64), indexing="ij")
    image = (torch.sin(x) * torch.cos(y)).double()[None, None]
    gx, gy = gradient(image, presets.paper(border="replicate"))
    gx[..., [0, -1]] *= 2  # one-sided differences span one pixel, not two
    gy[..., [0, -1], :] *= 2
    torch.testing.assert_close(integrate(gx, gy), image - image.mean(), atol=2e-3, rtol=0)


def test_starting_images_look_like_the_photograph_up_to_the_sign_if_unsigned() -> None:
    image, signed, unsigned = photograph(64), presets.uoctti(8), presets.paper(8)
    assert correlation(starting_images(histograms(image, signed), signed, 64, 64, 1, seed=0), image) > 0.8
    start = starting_images(histograms(image, unsigned), unsigned, 64, 64, 1, seed=0)
    assert abs(correlation(start, image)) > 0.6


@BOTH
def test_starting_images_differ_by_seed_and_number_but_not_by_batch(spec: HOGSpec) -> None:
    votes = histograms(torch.cat([photograph(64), photograph(64, "coins")]).double(), spec)
    start = starting_images(votes, spec, 64, 64, 3, seed=0)
    assert start.mean().item() == pytest.approx(0.5, abs=0.01)
    assert not torch.equal(start[:, 0], start[:, 1])
    assert not torch.equal(start, starting_images(votes, spec, 64, 64, 3, seed=1))
    torch.testing.assert_close(start[1:], starting_images(votes[1:], spec, 64, 64, 3, seed=0))


@pytest.mark.parametrize("spec", [presets.uoctti((8, 4)), presets.paper(8)], ids=["rectangular", "unsigned"])
def test_a_starting_image_has_about_the_contrast_of_the_votes(spec: HOGSpec) -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    image = (0.5 + 0.3 * torch.exp(-((x - 30).square() + (y - 34).square()) / 300)).double()[None, None]
    start = starting_images(histograms(image, spec), spec, 64, 64, 1, seed=0)
    assert 0.6 < (start.std() / image.std()).item() < 1.3  # a mean of sign patterns is fainter than each


def test_noise_is_seeded_the_same_in_every_batch_and_cancels_in_pairs() -> None:
    before = torch.get_rng_state()
    pairs = in_pairs(LIKE, 40, 50, 3, seed=3, spread=0.2)
    assert torch.equal(torch.get_rng_state(), before)
    assert pairs.shape == (1, 3, 1, 40, 50)
    assert pairs.std().item() == pytest.approx(0.2, rel=0.1)
    assert torch.equal(pairs[:, 2], -pairs[:, 0])
    assert torch.equal(pairs[:, :2], noise(LIKE, 40, 50, 2, seed=3, spread=0.2))
    assert not torch.equal(noise(LIKE, 40, 50, 1, seed=4), noise(LIKE, 40, 50, 1, seed=3))


@BOTH
def test_at_contrast_is_the_projection_of_the_histograms(spec: HOGSpec) -> None:
    images = torch.cat([photograph(32), photograph(32, "coins")]).double()
    votes = histograms(images.flip(0), spec)
    made = at_contrast(images, votes, spec)
    own = histograms(made, spec)
    torch.testing.assert_close((own * (votes - own)).sum(dim=(1, 2, 3)), torch.zeros(2, dtype=torch.float64))
    torch.testing.assert_close(at_contrast(0.2 + 0.3 * images, votes, spec), made)
    constant = torch.full_like(images, 0.2)
    torch.testing.assert_close(at_contrast(constant, votes, spec), torch.full_like(images, 0.5))


def test_images_are_stretched_to_the_unit_range_or_shifted_where_the_contrast_is_known() -> None:
    ramp = torch.linspace(-3, 5, 10_000).reshape(1, 1, 100, 100)
    stretched = to_unit_range(ramp, presets.uoctti())
    assert ((stretched == 0) | (stretched == 1)).float().mean().item() == pytest.approx(0.01, abs=1e-3)
    assert stretched[0, 0, 0, 0] < stretched[0, 0, -1, -1]
    shifted = to_unit_range(ramp / 16 + 9, presets.paper())  # Eq. 7 as printed fixes the contrast
    torch.testing.assert_close(shifted, ramp / 16 + 0.5 - 1 / 16, atol=1e-3, rtol=0)
    assert torch.equal(to_unit_range(torch.ones(1, 1, 4, 4), presets.uoctti()), torch.full((1, 1, 4, 4), 0.5))
