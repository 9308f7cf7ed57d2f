"""Several answers to one unsigned descriptor."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from nablahog import hog, metrics, presets
from nablahog.hog import HOGSpec
from nablahog.invert import Search, default_prior, reconstruct_samples

from .photographs import photograph

FEW = Search(max_evaluations=4)
TWO = torch.cat([photograph(64), photograph(64, "coins")])


@pytest.mark.parametrize("spec", [presets.paper(8), presets.skimage(transform_sqrt=True)], ids=lambda spec: spec.name)
def test_samples(spec: HOGSpec) -> None:
    descriptor = hog(TWO, spec)
    samples = reconstruct_samples(descriptor, spec, count=3, search=FEW)
    assert samples.image.shape == (2, 3, 1, 64, 64)
    assert samples.distance.shape == (2, 3)
    for index in range(2):
        image = samples.image[index, :, 0]
        pairs = [abs(metrics.cross_correlation(image[a], image[b])) for a, b in ((0, 1), (0, 2), (1, 2))]
        assert float(samples.agreement[index]) == pytest.approx(sum(pairs) / 3, abs=1e-4)
        assert 0.05 < float(samples.agreement[index]) < 0.999


def test_the_seed_decides_alone() -> None:
    before = torch.get_rng_state()
    descriptor, prior = hog(TWO, "paper"), default_prior("paper")
    first = prior.samples(descriptor, "paper", (64, 64), 4)
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(prior.samples(descriptor, "paper", (64, 64), 4), first)
    assert not torch.equal(prior.samples(descriptor, "paper", (64, 64), 4, seed=1), first)
    assert_close(prior.samples(descriptor[1:], "paper", (64, 64), 4), first[1:], rtol=1e-4, atol=1e-4)
    expected = prior.expected(descriptor, "paper", (64, 64))
    assert_close(prior.expected(descriptor, "paper", (64, 64)), expected)  # nothing is left out any longer


def test_samples_are_negatives_as_often_as_the_prior_thinks() -> None:
    descriptor, prior = hog(TWO[:1], "paper"), default_prior("paper")
    draws = prior.samples(descriptor, "paper", (64, 64), 400)[0]
    odds = prior.polarity_confidence(draws, descriptor.expand(400, -1, -1, -1), "paper")
    one_side = torch.maximum(odds, 1 - odds).mean()
    assert float((odds > 0.5).float().mean()) == pytest.approx(float(one_side), abs=0.1)


def test_what_leaves_nothing_open() -> None:
    descriptor = hog(TWO, "paper")
    with pytest.raises(ValueError, match=r"^expected at least 2 samples, got 1$"):
        reconstruct_samples(descriptor, "paper", count=1)
    with pytest.raises(TypeError, match=r"^prior must be a LearnedPrior, a list of these or 'default', got None$"):
        reconstruct_samples(descriptor, "paper", prior=None)
    with pytest.raises(ValueError, match=r"^samples are drawn of unsigned descriptors, this prior is for signed ones$"):
        reconstruct_samples(hog(TWO, "uoctti"), "uoctti")
