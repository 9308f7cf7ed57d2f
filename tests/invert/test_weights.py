"""Means and variances that a network normalises by: part of its weights, and taken out of them again."""

from __future__ import annotations

import torch
from torch import nn
from torch.testing import assert_close

from nablahog.invert.prior_network import ResidualBlock
from nablahog.io.network_weights import fold_statistics, unfold_statistics

INPUT = 3 * torch.randn(4, 6, 8, 8, generator=torch.Generator().manual_seed(0)) + 1


def _trained() -> ResidualBlock:
    """A block that has seen inputs, and whose weights are no longer those of the beginning."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        block = ResidualBlock(6)
        for weights in block.parameters():
            nn.init.normal_(weights)
        for _ in range(100):
            block(2 * torch.randn(4, 6, 8, 8) - 1)
    return block.eval()


@torch.no_grad()
def test_answers_stay_the_same() -> None:
    block = _trained()
    before = block(INPUT)
    fold_statistics(block)
    for layer in (block.normalise_a, block.normalise_b):
        assert_close(layer.running_mean, torch.zeros(6))
        assert_close(layer.running_var, torch.ones(6))
    assert_close(block(INPUT), before, rtol=1e-4, atol=1e-4)
    unfold_statistics(block, lambda: [block(INPUT), block(INPUT + 1)])
    assert block.training
    assert float(block.normalise_a.running_mean.abs().min()) > 0.1
    assert_close(block.eval()(INPUT), before, rtol=1e-4, atol=1e-4)


@torch.no_grad()
def test_in_training_answers_to_what_was_seen_stay_the_same() -> None:
    """For then the means and variances of the batch are those taken."""
    block = _trained()
    fold_statistics(block)
    before = block(INPUT)
    unfold_statistics(block, lambda: block(INPUT))
    assert_close(block(INPUT), before, rtol=1e-3, atol=1e-3)
