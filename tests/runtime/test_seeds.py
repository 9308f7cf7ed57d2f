"""Random numbers that are the same every time."""

from __future__ import annotations

import torch

from nablahog.runtime.seeds import seeded


def test_the_generator_goes_on_as_before() -> None:
    torch.manual_seed(7)
    expected = torch.rand(4)
    torch.manual_seed(7)
    first = torch.rand(2)
    with seeded(3):
        inside = torch.rand(2)
    assert torch.equal(torch.cat([first, torch.rand(2)]), expected)
    with seeded(3):
        assert torch.equal(torch.rand(2), inside)
