"""Gradient descent with momentum, the heavy ball (Polyak 1964), on a batch of independent problems."""

from __future__ import annotations

import torch
from torch import Tensor
from typing_extensions import Unpack

from .descent import descend
from .result import Minimum, ObjectiveFunction, Stopping


def momentum(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    first_step: float = 1.0,
    momentum: float = 0.9,
    **stopping: Unpack[Stopping],
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        first_step: length of the very first step, in the norm of the unknowns; see :mod:`.descent` for what follows.
        momentum: share of the velocity that each step keeps, in 0…1, 1 excluded; 0 is plain gradient descent.
        stopping: see :class:`.result.Stopping`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """

    def rule(gradient: Tensor, velocity: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        velocity = momentum * velocity - gradient
        return velocity, (velocity,)

    def step_size(gradient: Tensor) -> Tensor:
        norm = gradient.norm(dim=1)
        return torch.where(norm > 0, first_step / norm, 0)

    return descend(objective, start, rule, [torch.zeros_like(start)], step_size, **stopping)
