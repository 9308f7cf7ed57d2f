"""Operations that several normalisers are made from, with the derivatives stated in ``docs/derivatives.md``."""

from __future__ import annotations

import torch
from torch import Tensor


def root(values: Tensor) -> Tensor:
    """√ of each value, with derivative 0 at 0."""
    zero = values == 0
    return torch.where(zero, 0.0, torch.sqrt(torch.where(zero, 1.0, values)))


def clipped(entries: Tensor, clip: float) -> Tensor:
    """At most ``clip``; where equal, with the mean of the one-sided derivatives, which ``clamp`` has not."""
    return torch.minimum(entries, entries.new_tensor(clip))
