"""A prior for unsigned descriptors: one network for all dialects, to which left is as right, and bright as dark."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import hog, presets, reconstruct, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.invert import Search, scale_descriptors
from nablahog.invert.histograms import searchable
from nablahog.invert.unsigned_network import cell_votes, compressed, mirrored_votes

from ..io import tiny_models
from .photographs import photograph

PAPER = presets.paper(8)
UNSIGNED = {
    "paper": PAPER,
    "bins on the axes": dataclasses.replace(PAPER, bin_offset=0.0),
    "six bins, other sense": dataclasses.replace(PAPER, bins=6, counterclockwise=True),
    "skimage": presets.skimage(),
    "opencv": presets.opencv(),
    "maskfeat": presets.maskfeat(),
    "dalal_triggs": presets.dalal_triggs(),
    "aubry": presets.aubry(8),
    "vlfeat": presets.vlfeat("dalaltriggs"),
}
FEW = Search(max_evaluations=4)

every_dialect = pytest.mark.parametrize("spec", UNSIGNED.values(), ids=UNSIGNED)


def _votes(image: Tensor, spec: HOGSpec) -> Tensor:
    spec = searchable(spec)
    return cell_votes(histograms(image, spec), spec, (image.shape[2], image.shape[3]))


@every_dialect
def test_all_dialects_look_alike(spec: HOGSpec) -> None:
    image = photograph(128)
    ours, papers = (compressed(_votes(image, each)).flatten() for each in (spec, PAPER))
    assert ours.shape == papers.shape
    assert float(torch.corrcoef(torch.stack([ours, papers]))[0, 1]) > 0.9


def test_votes_on_a_centre_are_not_shared() -> None:
    image = photograph(128)
    assert torch.equal(_votes(image, PAPER), histograms(image, PAPER))


@pytest.mark.parametrize("size", [(128, 128), (64, 96), (200, 400), (480, 320), (16, 40), (9, 9)])
def test_what_the_network_takes_is_of_the_images_proportions(size: tuple[int, int]) -> None:
    image = photograph(128).repeat(1, 1, 4, 4)[..., : size[0], : size[1]]
    rows, cols = _votes(image, PAPER).shape[2:]
    assert rows % 4 == cols % 4 == 0
    assert 8 <= min(rows, cols) <= max(rows, cols) <= 20
    if min(size) >= 8 * 8:
        assert abs(rows / cols / (size[0] / size[1]) - 1) < 0.3


def test_mirrored_votes() -> None:
    image = photograph(128)
    assert_close(_votes(image.flip(3), PAPER), mirrored_votes(_votes(image, PAPER)), atol=1e-3, rtol=1e-4)


@every_dialect
def test_a_negative_is_as_unlikely_as_the_image_is_likely(spec: HOGSpec) -> None:
    image = photograph(128)
    descriptor, prior = hog(image, spec), tiny_models.prior(PAPER)
    one, other = (prior.polarity_confidence(each, descriptor, spec) for each in (image, 1 - image))
    assert one.shape == (1,)
    assert 0 < float(one) < 1
    assert abs(float(one) - 0.5) > 1e-6  # says something
    assert_close(one + other, torch.ones(1))


@every_dialect
def test_expected(spec: HOGSpec) -> None:
    images = torch.cat([photograph(128, name) for name in ("camera", "coins")])
    descriptors, prior = hog(images, spec), tiny_models.prior(PAPER)
    together = prior.expected(descriptors, spec, (128, 128))
    alone = torch.cat([prior.expected(each[None], spec, (128, 128)) for each in descriptors])
    assert_close(together, alone, atol=1e-3, rtol=0)
    assert_close(together.mean(dim=(1, 2, 3)), torch.full((2,), 0.5), atol=1e-4, rtol=0)


def test_expected_of_the_mirrored_image_is_mirrored() -> None:
    image, prior = photograph(128), tiny_models.prior(PAPER)
    one, other = (prior.expected(hog(each, PAPER), PAPER, (128, 128)) for each in (image, image.flip(3)))
    assert_close(other, one.flip(3), atol=1e-3, rtol=0)


def test_a_flat_image() -> None:
    descriptor, prior = hog(torch.full((1, 1, 64, 64), 0.3), PAPER), tiny_models.prior(PAPER)
    assert torch.isfinite(prior.expected(descriptor, PAPER, (64, 64))).all()
    result = reconstruct(descriptor, PAPER, prior=prior, search=FEW)
    assert torch.isfinite(result.image).all()
    assert_close(prior.polarity_confidence(torch.full((1, 1, 64, 64), 0.3), descriptor, PAPER), torch.tensor([0.5]))


@pytest.mark.parametrize("polarity", [True, False])
def test_the_prior_decides_which_side_is_bright(polarity: bool) -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "coins", "clock", "brick")])
    descriptors, prior = hog(images, PAPER), tiny_models.prior(PAPER)
    search = dataclasses.replace(FEW, polarity=polarity)
    result = reconstruct(descriptors, PAPER, prior=prior, search=search)
    assert result.polarity_confidence is not None
    own = prior.polarity_confidence(result.image, descriptors, PAPER)
    assert_close(result.polarity_confidence, own, atol=1e-4, rtol=0)
    assert (result.polarity_confidence >= 0.5).all() or not polarity
    array = reconstruct(descriptors[0].numpy(), PAPER, prior=prior, search=search)
    assert array.polarity_confidence is not None
    assert array.polarity_confidence.shape == ()
    assert reconstruct(descriptors, PAPER, search=FEW).polarity_confidence is None


@pytest.mark.parametrize("more", [False, True])
def test_multi_scale(more: bool) -> None:
    image, scales, prior = photograph(64), (16, 1), tiny_models.prior(PAPER)
    given = scale_descriptors(image, PAPER, scales) if more else hog(image, PAPER)
    levels = reconstruct_multiscale(given, PAPER, scales=scales, prior=prior, search=Search(max_evaluations=8))
    results = [level.reconstruction for level in levels]
    assert all(result.polarity_confidence is results[-1].polarity_confidence for result in results)
    assert results[-1].polarity_confidence is not None
    assert float(results[-1].polarity_confidence) >= 0.5


def test_signed_descriptors_know_which_side_is_bright() -> None:
    spec = presets.uoctti(8)
    image, prior = photograph(64), tiny_models.prior(spec)
    assert torch.equal(prior.polarity_confidence(1 - image, hog(image, spec), spec), torch.ones(1))


def test_multi_scale_of_a_signed_descriptor() -> None:
    spec = presets.uoctti(8)
    descriptor, few = hog(photograph(64), spec), Search(max_evaluations=8)
    with_prior, without = (
        reconstruct_multiscale(descriptor, spec, scales=(4, 1), prior=prior, search=few)
        for prior in (tiny_models.prior(spec), None)
    )
    assert torch.equal(with_prior[0].reconstruction.image, without[0].reconstruction.image)
    assert not torch.equal(with_prior[1].reconstruction.image, without[1].reconstruction.image)


def test_what_does_not_fit() -> None:
    prior, descriptor = tiny_models.prior(PAPER), hog(photograph(64), PAPER)
    signed = presets.uoctti(8)
    with pytest.raises(ValueError, match="prior was learned for unsigned descriptors, a uoctti descriptor is signed"):
        prior.expected(hog(photograph(64), signed), signed, (64, 64))
    with pytest.raises(ValueError, match="learned for signed descriptors, a paper descriptor is unsigned"):
        tiny_models.prior(signed).expected(descriptor, PAPER, (64, 64))
    with pytest.raises(ValueError, match="expected images and a prior contradict each other"):
        reconstruct(descriptor, PAPER, prior=prior, expected=photograph(64))
    for invert in (reconstruct, reconstruct_multiscale):
        with pytest.raises(ValueError, match="prior is an option of the default method"):
            invert(descriptor, PAPER, prior=prior, method="paper")
    with pytest.raises(ValueError, match="must have shape"):
        prior.polarity_confidence(photograph(32), descriptor, PAPER)
