"""Gradient descent with momentum, the heavy ball (Polyak 1964), on a batch of independent problems."""

from __future__ import annotations

import torch
from torch import Tensor

from .descent import descend
from .result import Minimum, ObjectiveFunction, Watch


class _HeavyBall:
    def __init__(self, like: Tensor, momentum: float) -> None:
        self.momentum = momentum
        self.velocity = torch.zeros_like(like)

    def displacement(self, gradient: Tensor) -> Tensor:
        self.velocity = self.momentum * self.velocity - gradient
        return self.velocity

    def restart(self, mask: Tensor) -> None:
        self.velocity[mask] = 0

    def select(self, mask: Tensor) -> None:
        self.velocity = self.velocity[mask]


def momentum(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    first_step: float = 1.0,
    momentum: float = 0.9,
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.
        first_step: length of the very first step, in the norm of the unknowns; see :mod:`.descent` for what follows.
        momentum: share of the velocity that each step keeps, in 0…1, 1 excluded; 0 is plain gradient descent.
        gradient_tolerance: stop a problem whose lowest point has no larger absolute gradient entry.
        progress_tolerance: stop a problem whose lowest value fell by less than this share of itself in 20 evaluations.
        watch: see :data:`Watch`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """
    x = start.detach().clone()
    value, gradient = objective(x, torch.arange(len(x), device=x.device))
    norm = gradient.norm(dim=1)
    return descend(
        objective,
        x,
        value,
        gradient,
        _HeavyBall(x, momentum),
        torch.where(norm > 0, first_step / norm, 0),
        max_evaluations=max_evaluations,
        gradient_tolerance=gradient_tolerance,
        progress_tolerance=progress_tolerance,
        watch=watch,
    )
