"""The numbers of each running problem of an L-BFGS search that its next step is decided by, wherever that is done."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class SearchState(NamedTuple):
    """A few numbers of each running problem, A of them, with m stored pairs.

    Attributes:
        values, slopes: (A,), the objective at the point, and its slope along the direction.
        steps, lows, highs: (A,), the step to the next trial, and its bracket.
        pairs: (A,) int64, stored so far.
        products: (A, m, 2m), of each stored y with all stored vectors, first s, then y.
        with_gradient: (A, 2m), those of the stored vectors with the gradient.
        peaks: (A,), the largest absolute number of the gradient.
    """

    values: Tensor
    slopes: Tensor
    steps: Tensor
    lows: Tensor
    highs: Tensor
    pairs: Tensor
    products: Tensor
    with_gradient: Tensor
    peaks: Tensor

    @classmethod
    def at_start(cls, values: Tensor, peaks: Tensor, slopes: Tensor, memory: int) -> SearchState:
        """On the device of the values (A,)."""
        bracket = torch.ones_like(values), torch.zeros_like(values), torch.full_like(values, torch.inf)
        pairs = torch.zeros_like(values, dtype=torch.long)
        products = values.new_zeros(len(values), memory, 2 * memory)
        return cls(values, slopes, *bracket, pairs, products, values.new_zeros(len(values), 2 * memory), peaks)


def steepest(gradient: Tensor, length: float) -> Tensor:
    """The direction of steepest descent (A, N), of a length."""
    norm = gradient.norm(dim=1, keepdim=True)
    return -gradient * torch.where(norm > 0, length / norm, 0)


def remaining(done: Tensor, *state: Tensor) -> list[Tensor]:
    """The rows of each tensor that are not ``done`` (A,), in place: the last of them fill the gaps, no others move.

    ``done`` is on the CPU, the tensors are all on one device.
    """
    count = len(done) - int(done.sum())
    gaps, last = done[:count].nonzero().squeeze(1), count + (~done[count:]).nonzero().squeeze(1)
    gaps, last = gaps.to(state[0].device), last.to(state[0].device)
    for tensor in state:
        tensor[gaps] = tensor[last]
    return [tensor[:count] for tensor in state]
