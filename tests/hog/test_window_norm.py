"""The centre-surround normaliser of Dalal and Triggs, and the preset that has it."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import BlockCells, WindowNorm, hog, presets

from .reference import window_norm
from .zoo import noise


@pytest.mark.parametrize("sigma", [0.2, 1.0, 1.5, 40.0])
def test_histograms_by_the_energy_around(sigma: float) -> None:
    scheme, votes = WindowNorm(sigma, 0.1), noise(2, 5, 7, 6)
    expected = [window_norm(each.permute(1, 2, 0).numpy(), scheme) for each in votes]
    result = scheme.normalize(votes, signed=False).permute(0, 2, 3, 1)
    assert_close(result, torch.stack([torch.from_numpy(each) for each in expected]), rtol=0, atol=1e-14)
    assert torch.autograd.gradcheck(lambda x: scheme.normalize(x, signed=False), votes.requires_grad_())


def test_nothing_beyond_three_sigma_counts() -> None:
    scheme = WindowNorm(0.7)
    assert scheme.reach() == 2
    votes = noise(1, 3, 9, 9)
    other = votes.clone()
    other[:, :, 7:] *= 2
    result = [scheme.normalize(x, signed=False)[:, :, :5] for x in (votes, other)]
    assert_close(*result, rtol=0, atol=1e-15)
    other[:, :, 6:] *= 2
    assert not torch.equal(scheme.normalize(other, signed=False)[:, :, :5], result[0])


@pytest.mark.parametrize("norm", ["L2-Hys", "L2", "L1-sqrt", "L1"])
def test_dalal_and_triggs_blocks(norm: Any) -> None:
    """Those of the paper's window: 7 x 15 blocks of 2x2 cells, σ of 8 pixels."""
    s = presets.dalal_triggs(norm=norm)
    assert (s.grid(128, 64), s.channels) == ((15, 7), 36)
    assert s.pooling == BlockCells((16, 16), (8, 8), 8.0)
    entries = hog(noise(1, 3, 128, 64), s).flatten(0, 2)
    length = entries.sum(1) if norm == "L1" else entries.square().sum(1).sqrt()
    assert_close(length, torch.ones_like(length), rtol=0, atol=0.02)  # but for ε
