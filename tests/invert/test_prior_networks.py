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
from nablahog.invert.prior.learned import network_class
from nablahog.invert.prior.signed_network import INPUT_SPEC, Architecture, SignedNetwork, network_inputs
from nablahog.invert.prior.unsigned_network import UnsignedNetwork
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
