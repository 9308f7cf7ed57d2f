"""Learned priors: one network for all signed dialects and one for all unsigned ones, and those of the package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.invert import (
    Iterate,
    Search,
    default_prior,
    reconstruct_samples,
    scale_descriptors,
)
from nablahog.invert.histograms import linear_vote_spec, recover_histograms, set_nominal_contrast
from nablahog.invert.prior.choice import PRIOR_FOLDER
from nablahog.invert.prior.confidence import Calibration, SignEvidence, compare_regions, smooth_regions
from nablahog.invert.prior.learned import network_class
from nablahog.invert.prior.signed_network import INPUT_SPEC, Architecture, SignedNetwork, network_inputs
from nablahog.invert.prior.unsigned_network import UnsignedNetwork
from nablahog.invert.starts import integrate, mean_gradient, starting_images
from nablahog.invert.unknowns import to_cosines

from ..io import tiny_models
from ..io.archives import check_refused
from .photographs import photograph

UOCTTI, PAPER = presets.uoctti(8), presets.paper(8)
SIGNED = {
    "uoctti": UOCTTI,
    "hard votes": presets.vlfeat(),
    "twelve bins, other sense": replace(UOCTTI, bins=12, counterclockwise=True),
    "dpm": presets.dpm(),
    "opencv, signed": presets.opencv((128, 128), nbins=18, signed=True),
}
UNSIGNED = {
    "paper": PAPER,
    "bins on the axes": replace(PAPER, bin_offset=0.0),
    "six bins, other sense": replace(PAPER, bins=6, counterclockwise=True),
    "opencv": presets.opencv(),
    "aubry": presets.aubry(8),
}
FEW = Search(max_evaluations=4)
BOTH = pytest.mark.parametrize("spec", [UOCTTI, PAPER], ids=["signed", "unsigned"])
every_dialect = pytest.mark.parametrize("spec", [*SIGNED.values(), *UNSIGNED.values()], ids=[*SIGNED, *UNSIGNED])


def cells(image: Tensor, spec: HOGSpec) -> Tensor:
    """What the network is given for an image."""
    searched, size = linear_vote_spec(spec), (image.shape[2], image.shape[3])
    return network_class(spec).rebin(histograms(image, searched), searched, size)


# --- the inputs of networks


@every_dialect
def test_all_dialects_look_alike(spec: HOGSpec) -> None:
    image = photograph(128)
    ours, theirs = (cells(image, each) for each in (UOCTTI if linear_vote_spec(spec).signed else PAPER, spec))
    assert ours.shape == theirs.shape
    ours, theirs = (x.div(x.mean()).log1p().flatten() for x in (ours, theirs))
    assert float(torch.corrcoef(torch.stack([ours, theirs]))[0, 1]) > 0.75


@BOTH
def test_votes_on_centres_are_kept_and_mirrored_with_the_image(spec: HOGSpec) -> None:
    image = photograph(128)
    assert torch.equal(cells(image, spec), histograms(image, spec))
    mirrored = network_class(spec).mirror(cells(image, spec))
    assert_close(cells(image.flip(3), spec), mirrored, atol=0.1, rtol=1e-3)


@pytest.mark.parametrize("size", [(64, 96), (200, 400), (512, 700), (9, 9)])
def test_the_input_has_the_images_proportions(size: tuple[int, int]) -> None:
    image = photograph(128).repeat(1, 1, 4, 6)[..., : size[0], : size[1]]
    rows, cols = cells(image, PAPER).shape[2:]
    assert rows % 4 == cols % 4 == 0
    assert 8 <= max(rows, cols) <= 64
    assert abs(np.log(rows / cols * size[1] / size[0])) < 0.35


def test_contrast_is_that_around_each_cell() -> None:
    """Cells of a hundredth of the contrast, far from the others, look as if they had all of it."""
    votes = cells(photograph(128), UOCTTI)
    faint = torch.cat([votes / 100, *[votes.mean(dim=3, keepdim=True) / 100] * 16, votes], dim=3)
    alone, beside = network_inputs(votes), network_inputs(faint)
    assert 0.5 < float(beside.integral[..., :128].std()) < 2
    assert float(beside.contrast[..., -1].mean() / beside.contrast[..., 0].mean()) > 30
    assert_close(alone.integral.mean(), torch.zeros(()), atol=1e-5, rtol=0)
    assert_close(alone.integral.std(correction=0), torch.ones(()), atol=1e-4, rtol=0)


def test_an_untrained_network_gives_the_integral() -> None:
    votes = cells(photograph(512)[..., :256, :200], UOCTTI)
    rows, cols = votes.shape[2:]
    network = SignedNetwork(Architecture((8, 8, 8), (1, 0, 0))).eval()
    size = 8 * rows, 8 * cols
    integral = integrate(*mean_gradient(set_nominal_contrast(votes, INPUT_SPEC, size), INPUT_SPEC, *size))
    assert_close(network._image(votes), integral, atol=1e-4, rtol=0)


def test_small_cells_are_seen_after_large_ones_together_with_what_these_are_expected_to_show() -> None:
    """Mirrored too, at each resolution."""
    network, seen = UnsignedNetwork(Architecture((8, 8, 8), (0, 0, 0))).eval(), []

    def forward(votes: Tensor, coarser: Tensor) -> Tensor:
        seen.append((tuple(votes.shape[2:]), coarser))
        rows, cols = votes.shape[2:]
        return torch.linspace(-1, 1, 2 * cols).expand(1, 1, 2 * rows, -1)

    network.forward = forward  # type: ignore[method-assign]
    votes = torch.rand(1, 9, 28, 60)
    largest = network.largest_cells(votes)
    regions = network.predict_regions(votes, largest)
    assert [grid for grid, _ in seen] == [(8, 16), (8, 16), (16, 32), (16, 32), (28, 60), (28, 60)]
    assert (regions.shape, largest.regions.shape) == ((1, 1, 56, 120), (1, 1, 16, 32))
    assert float(regions.abs().max()) == 1  # images and mirror images of opposite signs do not cancel
    coarser = seen[4][1]
    assert (coarser.shape, bool((seen[0][1] == 0).all())) == ((1, 1, 56, 120), True)
    assert torch.equal(seen[5][1], coarser.flip(3))


# --- the expected image


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


@BOTH
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


@BOTH
def test_a_flat_image(spec: HOGSpec) -> None:
    flat = torch.full((1, 1, 64, 64), 0.3)
    descriptor, prior = hog(flat, spec), tiny_models.prior(spec)
    assert torch.isfinite(prior.expected(descriptor, spec, (64, 64))).all()
    assert torch.isfinite(reconstruct(descriptor, spec, prior=prior, search=FEW).image).all()
    assert float(prior.polarity_confidence(flat, descriptor, spec)) == (1.0 if spec.signed else 0.5)


# --- polarity


def test_confidences_of_an_image_and_its_negative_sum_to_one() -> None:
    for spec in UNSIGNED.values():
        image = photograph(128)
        descriptor, prior = hog(image, spec), tiny_models.prior(PAPER)
        for confidence in (prior.polarity_confidence, prior.region_confidence):
            one, other = (confidence(each, descriptor, spec) for each in (image, 1 - image))
            assert float((one - 0.5).abs().max()) > 1e-6  # says something
            assert_close(one + other, torch.ones_like(one))
            flat = confidence(torch.full_like(image, 0.5), descriptor, spec)  # its own negative
            assert torch.equal(flat, torch.full_like(flat, 0.5))


def test_confidences_of_a_batch_are_those_of_each() -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "coins")] * 5)  # more than are judged at once
    descriptors, prior = hog(images, PAPER), tiny_models.prior(PAPER)
    together = prior.confidence(images, descriptors, PAPER)
    alone = [prior.confidence(images[k : k + 1], descriptors[k : k + 1], PAPER) for k in range(len(images))]
    assert float((together.regions[0] - together.regions[1]).abs().max()) > 1e-6
    for whole, parts in zip(together, zip(*alone, strict=True), strict=True):
        assert_close(whole, torch.cat(parts), atol=1e-5, rtol=0)


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


def test_regions_are_sure_where_draws_agree_and_as_far_as_the_image_is() -> None:
    """A region that all draws have is as sure as its image; of one that half of them negate nothing is known."""
    image = torch.zeros(1, 1, 64, 64)
    image[..., :40, :40], image[..., 44:, 44:] = 1, -1  # gray elsewhere
    draws = image[..., ::4, ::4].repeat(1, 8, 1, 1)
    draws[:, :4, 11:, 11:] *= -1
    draws[:, ::2] *= -1  # each is up to its sign
    agreement = compare_regions(smooth_regions(image), draws)
    assert agreement.shape == (1, 1, 16, 16)
    calibration = Calibration(1.0, 0.9, 0.0, 100.0)
    for polarity in (0.6, 0.9):
        chances = calibration.regions(SignEvidence(torch.zeros(1), agreement), torch.tensor([polarity]), (64, 64))
        assert float(chances[0, 0, 16, 16]) == pytest.approx(polarity, abs=1e-3)
        assert float(chances.max()) <= polarity + 1e-6
    assert float(agreement[0, 0, 4, 4]) > 2
    assert abs(float(agreement[0, 0, 13, 13])) < 0.5


def test_a_share_of_photographs_that_the_prior_is_blind_to_limits_its_confidence() -> None:
    calibration = Calibration(0.5, 0.8)
    chances = calibration.polarity(torch.tensor([-1e3, -2.0, 0.0, 2.0, 1e3]))
    expected = [0.1, 0.5 - 0.8 * (1 / (1 + np.exp(-1)) - 0.5), 0.5, 0.5 + 0.8 * (1 / (1 + np.exp(-1)) - 0.5), 0.9]
    assert_close(chances, torch.tensor(expected, dtype=torch.float32))


# --- in a reconstruction


def test_what_a_prior_expects_is_shown_first() -> None:
    descriptor, seen = hog(photograph(64), UOCTTI), []

    def watch(iterate: Iterate) -> None:
        seen.append((iterate.candidates.clone(), iterate.evaluations))

    reconstruct(descriptor, UOCTTI, watch=watch, search=FEW)
    assert (seen[0][1] == 0).all()
    assert_close(seen[0][0][:, 0], default_prior(UOCTTI).expected(descriptor, UOCTTI, (64, 64)))


@pytest.mark.parametrize("spec", [presets.opencv(), presets.dpm()], ids=lambda spec: spec.name)
def test_the_packages_priors_are_the_default(spec: HOGSpec) -> None:
    """For unsigned descriptors, the signed one adds details to what the unsigned one expects."""
    descriptor = hog(photograph(128), spec)
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


@pytest.mark.parametrize("more", [False, True])
@BOTH
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


def test_draws_depend_on_the_seed_and_are_negatives_as_often_as_the_prior_thinks() -> None:
    before = torch.get_rng_state()
    descriptor, prior = hog(photograph(64), "paper"), default_prior("paper")
    expected = prior.expected(descriptor, "paper", (64, 64))
    draws = prior.samples(descriptor, "paper", (64, 64), 200)
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(prior.samples(descriptor, "paper", (64, 64), 200), draws)
    assert not torch.equal(prior.samples(descriptor, "paper", (64, 64), 200, seed=1), draws)
    assert_close(prior.expected(descriptor, "paper", (64, 64)), expected)  # without dropout again
    odds = prior.polarity_confidence(draws[0], descriptor.expand(200, -1, -1, -1), "paper")
    assert float((odds > 0.5).float().mean()) == pytest.approx(float(torch.maximum(odds, 1 - odds).mean()), abs=0.12)


# --- refusals and files


def test_what_does_not_fit() -> None:
    prior, descriptor = tiny_models.prior(PAPER), hog(photograph(64), PAPER)
    of_signed = hog(photograph(64), UOCTTI)
    with pytest.raises(ValueError, match=r"prior is for unsigned descriptors, .* uoctti descriptor is signed"):
        prior.expected(of_signed, UOCTTI, (64, 64))
    with pytest.raises(ValueError, match="expected images and a prior contradict each other"):
        reconstruct(descriptor, PAPER, prior=prior, expected=photograph(64))
    with pytest.raises(ValueError, match="must have shape"):
        prior.polarity_confidence(photograph(32), descriptor, PAPER)
    for several in ([], [default_prior("paper")], [default_prior("uoctti")] * 2):
        with pytest.raises(ValueError, match="expected one prior for signed descriptors, and at most one for others"):
            reconstruct(of_signed, UOCTTI, prior=several, search=FEW)
    wrong: list[Any] = ["best", [None]]
    for none in wrong:
        with pytest.raises(TypeError, match="prior must be a LearnedPrior"):
            reconstruct(descriptor, PAPER, prior=none, search=FEW)
    with pytest.raises(ValueError, match="count must be an integer"):
        reconstruct_samples(descriptor, PAPER, count=1)
    with pytest.raises(TypeError, match="prior must be a LearnedPrior"):
        reconstruct_samples(descriptor, PAPER, prior=None)
    with pytest.raises(ValueError, match="need a prior for unsigned descriptors"):
        reconstruct_samples(of_signed, UOCTTI)


COUNT = len(tiny_models.prior().weights)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"weights": np.full(COUNT, np.nan, np.float16)}, "the weights must lie within ±65504, got NaN, Inf or more"),
        ({"weights": np.zeros(COUNT - 1, np.float16)}, rf"shape \({COUNT},\), got float16 of \({COUNT - 1},\)"),
        ({"weights": np.zeros(COUNT, np.float32)}, "must be float16 of shape .* got float32"),
        ({"spec": np.array(PAPER.to_json())}, "the weights must be"),
        ({"widths": np.array([8, 8, 0])}, "widths must be integers in 1…1024"),
        (
            {"widths": np.array([8] * 4), "blocks": np.array([1, 0, 0, 0])},
            "a prior for signed descriptors has 3 widths",
        ),
        ({"blocks": np.array([1, 0, 0, 0])}, "as many widths as blocks"),
    ],
)
def test_files_that_contradict_themselves_are_refused(tmp_path: Path, changed: dict[str, Any], says: str) -> None:
    check_refused(tiny_models.prior(), tmp_path / "p.npz", changed, says)


@pytest.mark.parametrize(
    "numbers",
    [
        (1.0,),
        (1.0, 1.1, 0.0, 1.0),
        (-1.0, 1.0, 0.0, 1.0),
        (1.0, 1.0, np.nan, 1.0),
        ("1", 1.0, 0.0, 1.0),
        (True, 1.0, 0.0, 1.0),
    ],
)
def test_calibrations_other_than_four_numbers_in_range_are_refused(numbers: tuple[Any, ...]) -> None:
    prior = tiny_models.prior(PAPER)
    with pytest.raises(ValueError, match="calibration must be"):
        replace(prior, learning=replace(prior.learning, calibration=numbers))


def test_a_package_without_its_priors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.prior.choice.PRIOR_FOLDER", tmp_path)
    with pytest.raises(FileNotFoundError, match=r"no unsigned\.npz, the prior for unsigned descriptors"):
        reconstruct(hog(photograph(64), PAPER), PAPER, search=FEW)


@pytest.mark.parametrize("spec", ["paper", "uoctti"])
def test_the_readme_says_where_the_packages_priors_are_from(spec: str) -> None:
    prior, readme = default_prior(spec), (PRIOR_FOLDER / "README.md").read_text(encoding="utf-8")
    assert default_prior(spec) is prior
    for text in (prior.learning.sha256, f"{len(prior.learning.images):,} ", f"--epochs {prior.learning.epochs}"):
        assert text in readme
    assert f"seed {prior.learning.seed}" in readme
    assert prior.learning.start in readme
    assert sum(file.stat().st_size for file in PRIOR_FOLDER.glob("*.npz")) <= 16 * 10**6
