"""What every test shares."""

from __future__ import annotations

import warnings

import pytest
import torch
from hypothesis import settings

# derandomized: a failure belongs to a change, never to the luck of the run
settings.register_profile("nablahog", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("nablahog")

# On a machine that is busy with something else, threads that wait for each other make minutes of seconds.
torch.set_num_threads(1)

# The first use of forward mode in a process makes PyTorch itself call a function it has deprecated, and our tests turn
# warnings into errors.
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    torch.func.jvp(torch.sin, (torch.zeros(1),), (torch.ones(1),))


@pytest.fixture(autouse=True)
def _same_numbers_every_time() -> None:
    """A failure belongs to a change here, too."""
    torch.manual_seed(0)
