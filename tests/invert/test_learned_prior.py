"""Learned priors: what they expect, alone and in reconstructions, and samples."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from nablahog import hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.invert import Iterate, Search, default_prior, reconstruct_samples, scale_descriptors
from nablahog.invert.histograms import linear_vote_spec, recover_histograms
from nablahog.invert.starts import starting_images
from nablahog.invert.unknowns import to_cosines

from ..io import tiny_models
from .photographs import photograph
from .prior_dialects import FEW, PAPER, UOCTTI, every_dialect, signed_and_unsigned

# --- the expected image


@pytest.mark.slow
@every_dialect
def test_expected_of_a_batch_is_that_of_each_at_the_contrast_of_the_histograms(spec: HOGSpec) -> None:
    images, prior = torch.cat([photograph(128, name) for name in ("camera", "coins")]), tiny_models.prior(spec)
    descriptors = hog(images, spec)
    together = prior.expected(descriptors, spec, (128, 128))
    alone = torch.cat([prior.expected(each[None], spec, (128, 128)) for each in descriptors])
    assert_close(together, alone, atol=1e-3, rtol=0)
    assert_close(together.mean(dim=(1, 2, 3)), torch.full((2,), 0.5), atol=1e-4, rtol=0)
    searched = linear_vote_spec(spec)
    votes = recover_histograms(descriptors, searched, (128, 128))
    own = histograms(together, searched)
    assert float((own * votes).sum() / own.square().sum()) == pytest.approx(1, abs=2e-2)


@signed_and_unsigned
@pytest.mark.parametrize("size", [(43, 50), (9, 61)])
def test_expected_has_the_images_size_and_is_mirrored_with_it(spec: HOGSpec, size: tuple[int, int]) -> None:
    image, prior = photograph(64).double()[..., : size[0], : size[1]], tiny_models.prior(spec)
    expected = prior.expected(hog(image, spec), spec, size)
    assert (expected.shape, expected.dtype) == ((1, 1, *size), torch.float64)
    assert torch.isfinite(expected).all()
    whole = photograph(64)
    one, other = (prior.expected(hog(each, spec), spec, (64, 64)) for each in (whole, whole.flip(3)))
    assert_close(other, one.flip(3), atol=1e-3, rtol=0)


@pytest.mark.parametrize("cell_size", [3, (8, 4), 32])
def test_cells_of_any_size(cell_size: int | tuple[int, int]) -> None:
    spec = presets.uoctti(cell_size)
    image = photograph(64)[..., :50, :60]
    expected = tiny_models.prior().expected(hog(image, spec), spec, (50, 60))
    assert expected.shape == image.shape
    assert torch.isfinite(expected).all()


def test_a_known_contrast_is_kept() -> None:
    """Eq. 7 as printed tells the contrast; half of it is expected at half of it."""
    spec = replace(PAPER, signed=True, bins=18)
    image, prior = photograph(64), tiny_models.prior(spec)
    whole, half = (prior.expected(hog(0.5 + c * (image - 0.5), spec), spec, (64, 64)) - 0.5 for c in (1, 0.5))
    assert_close(half, whole / 2, atol=1e-3, rtol=0)


@signed_and_unsigned
def test_a_flat_image(spec: HOGSpec) -> None:
    flat = torch.full((1, 1, 64, 64), 0.3)
    descriptor, prior = hog(flat, spec), tiny_models.prior(spec)
    assert torch.isfinite(prior.expected(descriptor, spec, (64, 64))).all()
    assert torch.isfinite(reconstruct(descriptor, spec, prior=prior, search=FEW).image).all()
    assert float(prior.polarity_confidence(flat, descriptor, spec)) == (1.0 if spec.signed else 0.5)


def test_the_packages_priors_expect_photographs_and_no_negatives() -> None:
    """Measured: correlations of 0.97 and 0.98 (signed), 0.59 and 0.56 (unsigned), and confidences of 0.92 and 0.57."""
    images = torch.cat([photograph(128, name) for name in ("camera", "coffee")])
    for spec, least in ((UOCTTI, 0.96), (PAPER, 0.5)):
        expected = default_prior(spec).expected(hog(images, spec), spec, (128, 128))
        for a, b in zip(expected, images, strict=True):
            assert float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1]) > least
    assert (default_prior("paper").polarity_confidence(images, hog(images, PAPER), PAPER) > 0.53).all()


def test_what_is_larger_than_cells_comes_from_the_integral() -> None:
    spec, size = presets.uoctti(4), (128, 128)
    descriptor = hog(photograph(128, "camera"), spec)
    votes = recover_histograms(descriptor, spec, size)
    expected = default_prior(spec).expected(descriptor, spec, size, votes)
    integral = starting_images(votes, spec, *size, count=1, seed=0, spread=0.0)[:, 0]
    large, difference = (to_cosines(image)[..., :3, :3].abs().max() for image in (integral - 0.5, expected - integral))
    assert difference < 0.02 * large


# --- in a reconstruction


def test_what_a_prior_expects_is_shown_first() -> None:
    descriptor, seen = hog(photograph(64), UOCTTI), []

    def watch(iterate: Iterate) -> None:
        seen.append((iterate.candidates.clone(), iterate.evaluations))

    reconstruct(descriptor, UOCTTI, watch=watch, search=FEW)
    assert (seen[0][1] == 0).all()
    assert_close(seen[0][0][:, 0], default_prior(UOCTTI).expected(descriptor, UOCTTI, (64, 64)))


@pytest.mark.slow
@pytest.mark.parametrize("spec", [presets.opencv(), presets.dpm()], ids=lambda spec: spec.name)
def test_the_packages_priors_are_the_default(spec: HOGSpec) -> None:
    """For unsigned descriptors, the signed one adds details to what the unsigned one expects."""
    descriptor = hog(photograph(64), spec)
    own = default_prior(spec)
    several = [own] if own.signed else [own, default_prior("uoctti")]
    few = Search(max_evaluations=30)
    both, alone, none = (reconstruct(descriptor, spec, prior=prior, search=few) for prior in (several, own, None))
    default = reconstruct(descriptor, spec, search=few)
    assert torch.equal(default.image, both.image)
    assert torch.equal(default.image, alone.image) == own.signed
    assert not torch.equal(default.image, none.image)
    for without in ({"expected": both.image, "search": few}, {"search": replace(few, samples=1)}):
        given = (reconstruct(descriptor, spec, **without, **none) for none in ({}, {"prior": None}))  # type: ignore[arg-type]
        assert torch.equal(*(each.image for each in given))
    assert float(default.evaluations) <= 30
    if not own.signed:
        assert float(metrics.cross_correlation(default.image[0, 0], alone.image[0, 0])) > 0.8


def test_details_come_after_three_tenths_of_the_evaluations() -> None:
    descriptor, prior, few = hog(photograph(64), PAPER), tiny_models.prior(PAPER), Search(max_evaluations=20)
    several = [prior, tiny_models.prior()]
    both, alone = (reconstruct(descriptor, PAPER, prior=given, search=few).history for given in (several, prior))
    assert (both == alone).flatten().tolist().index(False) == 6


@pytest.mark.slow
@pytest.mark.parametrize("more", [False, True])
@signed_and_unsigned
def test_multi_scale(spec: HOGSpec, more: bool) -> None:
    image, prior = photograph(64), tiny_models.prior(spec)
    given = scale_descriptors(image, spec, (4, 1)) if more else hog(image, spec)
    with_prior, without = (
        [each.reconstruction for each in reconstruct_multiscale(given, spec, scales=(4, 1), prior=p, search=FEW)]
        for p in (prior, None)
    )
    if spec.signed or not more:  # else it only decides the polarity
        assert not torch.equal(with_prior[1].image, without[1].image)
    if spec.signed:
        assert torch.equal(with_prior[0].image, without[0].image)
    else:
        assert with_prior[0].polarity_confidence is with_prior[1].polarity_confidence
        assert float(with_prior[1].polarity_confidence) >= 0.5
        assert with_prior[1].region_confidence.shape == image.shape


def test_a_search_from_a_prior_draws_no_random_numbers() -> None:
    descriptor = hog(photograph(64), PAPER)
    for prior, is_same in ((tiny_models.prior(PAPER), True), (None, False)):
        first, second = (reconstruct(descriptor, PAPER, prior=prior, search=FEW, seed=seed) for seed in (0, 1))
        assert torch.equal(first.image, second.image) == is_same


# --- samples


@pytest.mark.slow
@pytest.mark.parametrize("spec", [PAPER, presets.skimage(transform_sqrt=True)], ids=lambda spec: spec.name)
def test_samples_and_their_agreement(spec: HOGSpec) -> None:
    descriptor = hog(torch.cat([photograph(64), photograph(64, "coins")]), spec)
    samples = reconstruct_samples(descriptor, spec, count=3, search=FEW)
    assert samples.image.shape == (2, 3, 1, 64, 64)
    assert samples.distance.shape == (2, 3)
    for image, agreement in zip(samples.image[:, :, 0], samples.agreement, strict=True):
        pairs = [abs(metrics.cross_correlation(image[a], image[b])) for a, b in ((0, 1), (0, 2), (1, 2))]
        assert float(agreement) == pytest.approx(sum(pairs) / 3, abs=1e-4)
        assert 0.05 < float(agreement) < 0.999


@pytest.mark.slow
def test_draws_depend_on_the_seed_and_are_negatives_as_often_as_the_prior_thinks() -> None:
    before = torch.get_rng_state()
    descriptor, prior = hog(photograph(64), "paper"), default_prior("paper")
    expected = prior.expected(descriptor, "paper", (64, 64))
    draws, few, again = (prior.samples(descriptor, "paper", (64, 64), count) for count in (200, 8, 8))
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(again, few)
    assert not torch.equal(prior.samples(descriptor, "paper", (64, 64), 8, seed=1), few)
    assert_close(prior.expected(descriptor, "paper", (64, 64)), expected)  # without dropout again
    odds = prior.polarity_confidence(draws[0], descriptor.expand(200, -1, -1, -1), "paper")
    assert float((odds > 0.5).float().mean()) == pytest.approx(float(torch.maximum(odds, 1 - odds).mean()), abs=0.12)
