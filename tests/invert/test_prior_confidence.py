"""How sure learned priors are of the bright side, of images and of their regions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from nablahog import hog, reconstruct
from nablahog.invert.prior.confidence import Calibration, SignEvidence, compare_regions, smooth_regions

from ..io import tiny_models
from .photographs import photograph
from .prior_dialects import FEW, PAPER, UNSIGNED


@pytest.mark.slow
def test_confidences_of_an_image_and_its_negative_sum_to_one() -> None:
    for spec in UNSIGNED.values():
        image = photograph(64)
        descriptor, prior = hog(image, spec), tiny_models.prior(PAPER)
        for confidence in (prior.polarity_confidence, prior.region_confidence):
            one, other = (confidence(each, descriptor, spec) for each in (image, 1 - image))
            assert float((one - 0.5).abs().max()) > 1e-6  # says something
            assert_close(one + other, torch.ones_like(one))
            flat = confidence(torch.full_like(image, 0.5), descriptor, spec)  # its own negative
            assert torch.equal(flat, torch.full_like(flat, 0.5))


def test_without_a_calibration_log_odds_are_those_of_the_network() -> None:
    log_odds, agreement = torch.tensor([-1.0, 0.5]), torch.tensor([[[[2.0]]], [[[-3.0]]]])
    assert_close(Calibration().polarity(log_odds), torch.sigmoid(log_odds))
    sure = Calibration().regions(SignEvidence(log_odds, agreement), torch.ones(2), (4, 4))
    assert_close(sure, torch.sigmoid(agreement).expand(2, 1, 4, 4))


def test_confidences_of_a_batch_are_those_of_each() -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "coins")] * 5)  # more than are judged at once
    descriptors, prior = hog(images, PAPER), tiny_models.prior(PAPER)
    together = prior.confidence(images, descriptors, PAPER)
    alone = [prior.confidence(images[k : k + 1], descriptors[k : k + 1], PAPER) for k in range(len(images))]
    assert float((together.regions[0] - together.regions[1]).abs().max()) > 1e-6
    for whole, parts in zip(together, zip(*alone, strict=True), strict=True):
        assert_close(whole, torch.cat(parts), atol=1e-5, rtol=0)


def test_the_prior_decides_the_polarity() -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "coins", "clock", "brick")])
    descriptors, prior = hog(images, PAPER), tiny_models.prior(PAPER)
    result = reconstruct(descriptors, PAPER, prior=prior, search=FEW)
    assert result.polarity_confidence is not None
    own = prior.polarity_confidence(result.image, descriptors, PAPER)
    assert_close(result.polarity_confidence, own, atol=1e-4, rtol=0)
    assert (own >= 0.5).all()
    assert result.region_confidence is not None
    regions = prior.region_confidence(result.image, descriptors, PAPER)
    assert_close(result.region_confidence, regions, atol=1e-3, rtol=0)
    array = reconstruct(descriptors[0].numpy(), PAPER, prior=prior, search=FEW)
    assert array.polarity_confidence is not None
    assert array.polarity_confidence.shape == ()
    assert array.region_confidence is not None
    assert array.region_confidence.shape == (64, 64)
    without = reconstruct(descriptors, PAPER, search=FEW, prior=None)
    assert (without.polarity_confidence, without.region_confidence) == (None, None)


def test_regions_are_sure_where_much_is_predicted_and_as_far_as_the_image_is() -> None:
    """A region that is predicted is as sure as its image; of one where 0 is predicted nothing is known."""
    image = torch.zeros(1, 1, 64, 64)
    image[..., :40, :40], image[..., 44:, 44:] = 1, -1  # gray elsewhere
    predicted = image[..., ::4, ::4].clone()
    predicted[..., 11:, 11:] = 0
    agreement = compare_regions(smooth_regions(image), predicted)
    assert_close(agreement, compare_regions(smooth_regions(image), -predicted))  # it is up to its sign
    assert agreement.shape == (1, 1, 16, 16)
    calibration = Calibration(1.0, 0.9, 0.0, 100.0)
    for polarity in (0.6, 0.9):
        chances = calibration.regions(SignEvidence(torch.zeros(1), agreement), torch.tensor([polarity]), (64, 64))
        assert float(chances[0, 0, 16, 16]) == pytest.approx(polarity, abs=1e-3)
        assert float(chances.max()) <= polarity + 1e-6
    assert float(agreement[0, 0, 4, 4]) > 0.9
    assert abs(float(agreement[0, 0, 14, 14])) < 0.1


def test_a_share_of_photographs_that_the_prior_is_blind_to_limits_its_confidence() -> None:
    calibration = Calibration(0.5, 0.8)
    chances = calibration.polarity(torch.tensor([-1e3, -2.0, 0.0, 2.0, 1e3]))
    expected = [0.1, 0.5 - 0.8 * (1 / (1 + np.exp(-1)) - 0.5), 0.5, 0.5 + 0.8 * (1 / (1 + np.exp(-1)) - 0.5), 0.9]
    assert_close(chances, torch.tensor(expected, dtype=torch.float32))
