"""What the networks of learned priors are given, and in which order they see it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.invert.histograms import linear_vote_spec, set_nominal_contrast
from nablahog.invert.prior.confidence import Calibration, SignEvidence, smooth_regions
from nablahog.invert.prior.learned import network_class
from nablahog.invert.prior.signed_network import INPUT_SPEC, Architecture, SignedNetwork, network_inputs
from nablahog.invert.prior.unsigned_network import LargestCells, UnsignedNetwork
from nablahog.invert.starts import integrate, mean_gradient

from .photographs import photograph
from .prior_dialects import PAPER, UOCTTI, every_dialect, signed_and_unsigned


def cells(image: Tensor, spec: HOGSpec) -> Tensor:
    """What the network is given for an image."""
    searched, size = linear_vote_spec(spec), (image.shape[2], image.shape[3])
    return network_class(spec).rebin(histograms(image, searched), searched, size)


@every_dialect
def test_all_dialects_look_alike(spec: HOGSpec) -> None:
    image = photograph(128)
    ours, theirs = (cells(image, each) for each in (UOCTTI if linear_vote_spec(spec).signed else PAPER, spec))
    assert ours.shape == theirs.shape
    ours, theirs = (x.div(x.mean()).log1p().flatten() for x in (ours, theirs))
    assert float(torch.corrcoef(torch.stack([ours, theirs]))[0, 1]) > 0.75


@signed_and_unsigned
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


def ramp(cols: int) -> Tensor:
    """Pixels as bright as their centres are far from the middle, in widths of the image."""
    return ((torch.arange(cols) + 0.5) / cols - 0.5).expand(1, 1, cols, -1)


def test_what_is_resampled_stays_where_it_is() -> None:
    """But for pixels at the border."""
    network, seen = UnsignedNetwork(Architecture((8, 8, 8), (0, 0, 0))).eval(), []
    votes, unit = torch.rand(1, 9, 8, 8), ramp(16).std(correction=0)
    network.predict_regions = lambda *given: ramp(16)  # type: ignore[method-assign]
    assert_close(network.coarser(torch.rand(1, 9, 16, 16), None)[..., 1:-1], ramp(32)[..., 1:-1] / unit)  # type: ignore[arg-type]

    def judge(votes: Tensor, regions: Tensor, images: Tensor) -> Tensor:
        seen.append(images)
        return torch.ones(1)

    network.polarity.forward = judge  # type: ignore[method-assign]
    assert_close(network.log_odds(ramp(64), LargestCells(votes, ramp(16))), torch.ones(1))
    assert_close(seen[0][..., 1:-1], ramp(16)[..., 1:-1] / unit, atol=1e-2, rtol=0)
    dot = torch.zeros(1, 1, 64, 64)
    dot[..., 32, 32] = 1
    network.log_odds(dot, LargestCells(votes, ramp(16)))
    assert seen[2].any()  # no pixel is skipped
    assert smooth_regions(dot).any()
    drawn = network.draw(votes, PAPER, (64, 64), 1, 0, torch.ones_like)
    for image in (network.predict(votes, PAPER, (64, 64)), drawn):
        assert_close(image[..., 8:-8], ramp(64)[..., 8:-8], atol=5e-3, rtol=0)  # cubic
    evidence = SignEvidence(torch.zeros(1), torch.logit(0.5 + ramp(16)))
    chances = Calibration().regions(evidence, torch.ones(1), (64, 64))
    assert_close(chances[..., 2:-2], 0.5 + ramp(64)[..., 2:-2])
